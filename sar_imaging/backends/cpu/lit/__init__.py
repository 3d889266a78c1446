"""Tiles of image lines, and which of them an echo lights."""
