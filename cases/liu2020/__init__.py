"""Cases of Liu et al., Energies 13 (2020) 1841."""
