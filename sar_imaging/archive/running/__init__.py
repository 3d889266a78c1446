"""Pieces of an archive on Dask: records of what is finished, retries, losses, local or cluster."""
