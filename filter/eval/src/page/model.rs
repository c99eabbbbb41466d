//! Which model was measured, as a page shows it.

use maud::{Markup, html};

use crate::result::ModelRecord;

/// What a model is and its checksum, for [`definitions`](super::shell::definitions).
pub fn model_entries(model: &ModelRecord) -> [(&'static str, Markup); 2] {
    let ModelRecord { name, sha256, parameters, input_px: [width, height] } = model;
    let what = html! { (name) ", " (parameters) " parameters, input " (width) " × " (height) " pixels" };
    [("Model", what), ("SHA-256 of the model", html! { code { (sha256) } })]
}
