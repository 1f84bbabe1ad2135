"""Cases of the Janssen piston."""
