"""psflut reads distance from blur: tables of point spread functions, estimators, honest error bars."""

__version__ = "0.1.0"
