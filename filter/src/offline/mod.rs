//! Offline use: whole evaluations over simulated holes, and recordings played back.

pub mod assembly;
pub mod baselines;
pub mod evaluate;
pub mod extremes;
pub mod gathered;
pub mod replay;
pub mod report;
pub mod reproduction;
pub mod result;
pub mod story;
pub mod summary;
pub mod sweep;
