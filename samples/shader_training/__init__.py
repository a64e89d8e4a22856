"""A shader learned by a network: RTXNS's samples."""
