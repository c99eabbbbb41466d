//! An episode as it can be saved.

use serde::{Deserialize, Serialize};
use tactile_data::se2::Se2;

use crate::config::EpisodeConfig;
use crate::touch::Observation;

/// The value of [`EpisodeRecord::version`] that this program writes and reads.
pub const VERSION: u32 = 5;

/// The settings of an episode and what was touched. Serde writes it; [`Episode::restore`](crate::Episode::restore) plays
/// it again and gives every number as it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeRecord {
    /// [`VERSION`].
    pub version: u32,
    /// The settings.
    pub config: EpisodeConfig,
    /// SHA-256 of the bank, 64 hex digits.
    pub bank_sha256: String,
    /// Each touch with the motion since the one before; the first one's is no motion.
    pub touches: Vec<(Se2, Observation)>,
}
