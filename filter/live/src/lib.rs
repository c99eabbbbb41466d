//! Live touches: frames and poses in, decisions out.
