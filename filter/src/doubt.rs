//! How far the touches say that the network does not know what it is shown.

use crate::likelihood::{LikelihoodConfig, TouchLikelihood};

/// Nothing is doubted where the best matches of the edged touches have this cosine on average, as those of a sensor that the
/// network knows, and all where they have that. Neither has to be exact (`NOTES.md`).
const NOTHING_AND_ALL: [f64; 2] = [0.95, 0.7];

/// How many times more of their error the touches of one hole share where all is doubted than where nothing is, less one: what
/// a rough sensor or a part unlike those trained on does to one touch it does to the next.
const MORE_SHARED: f64 = 5.0;

/// The share of their error that touches have in common, 0..=1.
pub(crate) fn shared_error<'a>(config: &LikelihoodConfig, touches: impl Iterator<Item = &'a TouchLikelihood>) -> f64 {
    (config.shared_error * (1.0 + MORE_SHARED * doubt(touches))).min(1.0)
}

/// By the best matches of the touches that showed an edge, 0..=1; 0 where none did. A cosine of touches alone says it: a
/// calibration under a rough sensor expects low ones, and forgets it.
pub(crate) fn doubt<'a>(touches: impl Iterator<Item = &'a TouchLikelihood>) -> f64 {
    let (sum, n_edged) = touches
        .filter(|touch| !touch.blank)
        .fold((0.0, 0_usize), |(sum, n), touch| (sum + f64::from(touch.best_similarity), n + 1));
    let [nothing, all] = NOTHING_AND_ALL;
    if n_edged == 0 { 0.0 } else { ((nothing - sum / n_edged as f64) / (nothing - all)).clamp(0.0, 1.0) }
}
