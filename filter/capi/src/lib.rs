//! The filter as a C library.
