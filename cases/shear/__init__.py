"""Cases of shear flow."""
