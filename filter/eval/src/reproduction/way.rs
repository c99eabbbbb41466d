//! How much is done to make a sensor one's own.

use serde::{Deserialize, Serialize};

/// How much was done for a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// Nothing: the model as shipped, and a bank rendered under the default sensor; nothing is known of its light.
    Shipped,
    /// Its light is known, where it is another than the default's: pictures are brought under the lamps that the model
    /// knows.
    LightKnown,
    /// A bank rendered under this sensor.
    OwnBank,
    /// The same, and the confidence calibrated on letters for tuning under this sensor.
    Calibrated,
}

impl Way {
    pub(super) const ALL: [Self; 4] = [Self::Shipped, Self::LightKnown, Self::OwnBank, Self::Calibrated];

    /// The folder of a sensor's evaluation.
    pub(super) fn folder_of(self, sensor: &str) -> String {
        format!("sensor-{sensor}-{}", self.ending())
    }

    fn ending(self) -> &'static str {
        match self {
            Self::Shipped => "shipped",
            Self::LightKnown => "light-known",
            Self::OwnBank => "own-bank",
            Self::Calibrated => "calibrated",
        }
    }

    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Shipped => "as it comes",
            Self::LightKnown => "its light known",
            Self::OwnBank => "own bank",
            Self::Calibrated => "calibrated",
        }
    }
}

/// The folders of a sensor, in the order of the ways.
pub fn folders(sensor: &str) -> [String; 4] {
    Way::ALL.map(|way| way.folder_of(sensor))
}
