//! An episode as it can be saved.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::maps::verifier::Verifier;

use crate::config::EpisodeConfig;
use crate::episode::Episode;
use crate::error::{Error, Result};
use crate::insertion::Tried;
use crate::touch::Observation;

/// The value of [`EpisodeRecord::version`] that this program writes and reads.
pub const VERSION: u32 = 7;

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
    /// SHA-256 of what judges touches against the bank's maps, where something does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verifier_sha256: Option<String>,
    /// Each touch with the motion since the one before; the first one's is no motion.
    pub touches: Vec<(Se2, Observation)>,
    /// Each peg that was tried in vain, with the number of touches before it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tried: Vec<(usize, Tried)>,
}

impl Episode {
    /// What is needed to go on later, or elsewhere.
    ///
    /// # Errors
    /// None that a bank could have; building its checksum may fail in principle.
    pub fn record(&self) -> Result<EpisodeRecord> {
        Ok(EpisodeRecord {
            version: VERSION,
            config: self.config,
            bank_sha256: self.bank.sha256()?,
            verifier_sha256: self.bank.verifier().map(|verifier| verifier.sha256().to_owned()),
            touches: self.touches.clone(),
            tried: self.tried.clone(),
        })
    }

    /// An episode as it was when recorded, to the bit.
    ///
    /// # Errors
    /// A record of another bank or version, without a touch, or whose touches no episode could have taken in.
    pub fn restore(record: &EpisodeRecord, bank: Arc<Bank>) -> Result<Self> {
        let wrong = |expected, got| Err(Error::WrongBank { expected, got });
        if record.version != VERSION {
            return wrong(format!("version {VERSION}"), format!("version {}", record.version));
        }
        let sha256 = bank.sha256()?;
        if record.bank_sha256 != sha256 {
            return wrong(format!("one of bank {sha256:.12}"), format!("one of bank {:.12}", record.bank_sha256));
        }
        let verifier = bank.verifier().map(Verifier::sha256);
        if record.verifier_sha256.as_deref() != verifier {
            let of =
                |sha256: Option<&str>| sha256.map_or("no verifier".into(), |sha256| format!("verifier {sha256:.12}"));
            return wrong(of(verifier), of(record.verifier_sha256.as_deref()));
        }
        let Some(((_, first), later)) = record.touches.split_first() else {
            return wrong("at least one touch".into(), "none".into());
        };
        let mut episode = Self::begin(record.config, bank, first)?;
        let mut tried = record.tried.iter().peekable();
        for n_touches in 1..=record.touches.len() {
            if let Some((moved, observation)) = later.get(n_touches.wrapping_sub(2)) {
                episode.observe(*moved, observation)?;
            }
            while let Some((_, tried)) = tried.next_if(|(after, _)| *after == n_touches) {
                episode.did_not_fit(tried)?;
            }
        }
        match tried.next() {
            Some((after, _)) => {
                wrong("tries in order, after touches that were made".into(), format!("one after {after}"))
            }
            None => Ok(episode),
        }
    }
}
