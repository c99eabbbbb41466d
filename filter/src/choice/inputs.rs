//! What a choice of the next touch is made of.

use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;

use crate::belief::Belief;
use crate::config::EpisodeConfig;
use crate::decision::Unfelt;
use crate::touch_model::TouchModel;

/// What a choice is made in: what is believed, recorded and offered.
pub struct ChoiceInputs<'a> {
    /// Rule and effort.
    pub config: &'a EpisodeConfig,
    /// What is measured or fixed: the config's, in the metric of the bank, as the belief was made with.
    pub model: &'a TouchModel,
    /// What is known of part and pose.
    pub belief: &'a Belief,
    /// The recorded views.
    pub bank: &'a Bank,
    /// Motions `sensor_from_next` that the reach allows.
    pub candidates: &'a [Se2],
    /// What is left to feel of the named part, where it is as probable as naming it asks for.
    pub unfelt: Option<Unfelt>,
}
