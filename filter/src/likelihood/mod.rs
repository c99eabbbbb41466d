//! How likely one touch is at each recorded view, between views and where nothing was recorded.
//!
//! In: an observation, a bank and what was measured of the model. Out: [`TouchLikelihood`], and with the motion since the
//! first touch [`Evidence`](evidence::Evidence) from every pose; what touches share. It must not know which states are
//! believed, nor what is chosen or decided.

mod cosine_bounds;
pub mod evidence;
pub mod interpolation;
mod lattice;
mod match_model;
mod nearest;
mod new_share;
mod softplus;
mod touch_likelihood;

pub(crate) use match_model::{Felt, Foreseen};
pub(crate) use nearest::{Nearest, trusted};
pub(crate) use new_share::new_share;
pub use touch_likelihood::TouchLikelihood;
