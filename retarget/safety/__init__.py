"""The gate that every goal passes, and the clearance that it asks about."""
