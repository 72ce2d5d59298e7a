"""psflut reads distance from blur: tables of point spread functions, estimators, honest error bars.

The names below are what most people need; they are imported from their modules when first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "assembly": ["depthmap"],
        "capture": ["Setup", "ideal_image", "simulate"],
        "depthmaps": ["DepthMap"],
        "errors": ["PsflutError"],
        "estimation": ["Estimate", "Observation", "Outcome", "estimate"],
        "images": ["read_image"],
        "noise": ["Noise"],
        "optics": ["Camera"],
        "reporting": ["report"],
        "store": ["read_table", "write_table"],
        "table": ["PSFTable"],
    },
)
