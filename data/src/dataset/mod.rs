//! Touches on disk: what is said of each, how they are made, merged, looked at and written elsewhere.
//!
//! In: frames with what is known of each touch. Out: a [`Dataset`](store::Dataset), in whole or in shards. It must not know where
//! a recording came from.

#[cfg(feature = "sim")]
pub mod compare;
#[cfg(feature = "datasets")]
pub mod dataset_merge;
#[cfg(feature = "datasets")]
pub mod export;
#[cfg(feature = "sim")]
pub mod generate;
#[cfg(feature = "datasets")]
pub mod inspection;
#[cfg(feature = "sim")]
pub mod needs;
pub mod origin;
#[cfg(feature = "datasets")]
pub mod shard;
#[cfg(feature = "datasets")]
pub mod store;
pub mod touch;
