"""omnitrack_sim: the Omnidirectional Tractable Three Module Robot in pipes, on MuJoCo.

Public names stand in ``__init__.pyi``, each beside the module that defines it, and are loaded on
first use, so that ``import omnitrack_sim`` stays light.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
