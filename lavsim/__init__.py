"""A self-contained 2D/BEV town traffic simulator: numpy in, numpy out.

Importing this package is cheap: numba, matplotlib and the engines load on use, in the modules that need them.
"""

__version__ = "0.1.0"
