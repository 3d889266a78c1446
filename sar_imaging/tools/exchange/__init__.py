"""Files of other programs: what they hold, and recordings made of them and of which they are."""
