//! The filter as a Python module.
