//! The maps of a bank's parts, and what is known of touches that are laid over them.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;

use super::Bank;
use crate::calibration::presence::PresenceOdds;
use crate::error::{Error, Result};
use crate::maps::expected::Expected;
use crate::maps::mosaic::Mosaics;
use crate::maps::verifier::Verifier;

/// A map of each part, with what a verifier says of touches that were made on it and the verifier itself, where they are known.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PartMaps {
    mosaics: Mosaics,
    expected: Option<Expected>,
    verifier: Option<Arc<Verifier>>,
}

impl PartMaps {
    /// The same of some of the parts, in their order.
    pub(super) fn of_parts(&self, parts: &[usize]) -> Self {
        let expected = self.expected.as_ref().map(|expected| expected.of_parts(parts));
        Self { mosaics: self.mosaics.of_parts(parts), expected, verifier: self.verifier.clone() }
    }
}

impl Bank {
    /// The same bank, with a map of each part, by which touches can be verified.
    ///
    /// # Errors
    /// Another number of parts.
    pub fn with_mosaics(self, mosaics: Mosaics) -> Result<Self> {
        if mosaics.n_parts() != self.parts.len() {
            let expected = format!("one of each of {} parts", self.parts.len());
            return Err(Error::invalid("mosaics", expected, mosaics.n_parts().to_string()));
        }
        Ok(Self { maps: Some(Arc::new(PartMaps { mosaics, expected: None, verifier: None })), ..self })
    }

    /// The same bank, with what a verifier says of touches that were made on each part.
    ///
    /// # Errors
    /// A bank without maps, another number of parts, or numbers that no touches give.
    pub fn with_expected(self, expected: Expected) -> Result<Self> {
        expected.validate(self.parts.len())?;
        self.with_changed_maps(|maps| Ok(PartMaps { expected: Some(expected), ..maps }))
    }

    /// The same bank, against whose maps this network judges touches ([`Verifier`]). A bank's file does not hold it.
    ///
    /// # Errors
    /// A bank without maps, or one whose maps are of other networks.
    pub fn verified_by(self, verifier: Arc<Verifier>) -> Result<Self> {
        self.with_changed_maps(|maps| match &maps.expected {
            Some(Expected { maps_sha256, .. }) if maps_sha256 != verifier.sha256() => {
                let expected = format!("maps by {maps_sha256:.12}, with which the bank was made");
                Err(Error::invalid("maps", expected, format!("{:.12}", verifier.sha256())))
            }
            _ => Ok(PartMaps { verifier: Some(verifier), ..maps }),
        })
    }

    fn with_changed_maps(mut self, change: impl FnOnce(PartMaps) -> Result<PartMaps>) -> Result<Self> {
        let Some(maps) = self.maps.take() else {
            return Err(Error::invalid("bank", "one with a map of each part", "one without"));
        };
        Ok(Self { maps: Some(Arc::new(change(Arc::unwrap_or_clone(maps))?)), ..self })
    }

    /// The same bank, with the maps of another of the same parts and what judges touches against them.
    ///
    /// # Errors
    /// A bank of other parts.
    pub fn with_maps_of(self, other: &Self) -> Result<Self> {
        if self.parts != other.parts {
            return Err(Error::invalid("bank", format!("parts {}", self.parts.join(" ")), other.parts.join(" ")));
        }
        Ok(Self { maps: other.maps.clone(), ..self })
    }

    /// A map of each part, where the bank has them.
    pub fn mosaics(&self) -> Option<&Mosaics> {
        self.maps.as_deref().map(|maps| &maps.mosaics)
    }

    /// What a verifier says of touches that were made on each part, where that was measured.
    pub fn expected(&self) -> Option<&Expected> {
        self.maps.as_deref().and_then(|maps| maps.expected.as_ref())
    }

    /// The log-odds that a named part is there by what the verifier says where a side is touched; `None` where none judges, or they were
    /// not fitted.
    pub fn presence(&self, touched: Side) -> Option<&PresenceOdds> {
        self.verifier()?.presence(touched, self.mosaics()?.side_for(touched))
    }

    /// What judges touches against those maps, where it was given.
    pub fn verifier(&self) -> Option<&Verifier> {
        self.maps.as_deref().and_then(|maps| maps.verifier.as_deref())
    }
}
