"""Version of the package, and physical constants with the CODATA 2018 values, exact where the SI defines the constant."""

__version__ = "1.1.0"

SPEED_OF_LIGHT = 299_792_458.0  # m/s
BOLTZMANN = 1.380649e-23  # J/K
VACUUM_PERMITTIVITY = 8.8541878128e-12  # F/m
