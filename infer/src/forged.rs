//! Files of a model and a bank that say what cannot be, under checksums that fit: refused in one line.

use std::path::PathBuf;

use serde_json::{Value, json};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Preprocessing;
use tactile_data::pose::grid::PoseGrid;

use crate::bank::rows::Rows;
use crate::bank::similarity::normalize_rows;
use crate::bank::views::Views;
use crate::bank::{self, Bank};
use crate::calibration::match_odds::MatchOdds;
use crate::calibration::own_by_edge::OwnByEdge;
use crate::calibration::{Calibration, OfVerifier, Prior, Spread};
use crate::embedding::architecture::NetworkConfig;
use crate::embedding::checkpoint::{self, Checkpoint, Provenance};
use crate::embedding::device::DeviceKind;
use crate::embedding::model::Model;
use crate::embedding::precision::Precision;
use crate::safefile::SafeFile;

/// A model with a calibration and match odds of each side and a bank of it, each in a file of its own.
struct Whole {
    _folder: tempfile::TempDir,
    model: PathBuf,
    bank: PathBuf,
}

const CALIBRATION: Calibration = Calibration {
    low_similarity: 0.7,
    matched: Some(Spread { mean: 0.9, sd: 0.03 }),
    between_sensors: Some(0.01),
    steepness: Some(0.8),
    own_by_edge: Some(OwnByEdge { by_edge: 0.5, usual_edge: 1.5 }),
    views: Views::Pegs,
    verifier: Some(OfVerifier { maps_sha256: String::new(), nats: -1.5, n_touches: 10, strain: 0.25, misfit: 0.5 }),
    prior: Some(Prior {
        n_touches: 100.0,
        low_similarity: 0.7,
        matched: None,
        between_sensors: None,
        views: Views::Pegs,
    }),
    n_holes: 60,
};

fn odds() -> MatchOdds {
    MatchOdds {
        offset: 3.0,
        steepness: 24.0,
        steepness_by_edge: 0.27,
        own_distance: 0.38,
        distance_by_own: 0.5,
        rarity_by_edge: 0.5,
        usual_rarity: 0.0,
        rarity: vec![0.1; 6],
        n_touches: 100,
        log_probability: 2.5,
    }
}

impl Whole {
    fn new() -> Self {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let checkpoint = checkpoint.with_calibration(Side::Hole, CALIBRATION).with_calibration(Side::Peg, CALIBRATION);
        let checkpoint = checkpoint.with_match_odds(Side::Hole, odds()).with_match_odds(Side::Peg, odds());
        let folder = tempfile::tempdir().unwrap();
        let [model, bank] = ["model", "bank"].map(|name| folder.path().join(name));
        let sha256 = checkpoint.save(&model).unwrap();
        let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
        let mut rows: Vec<f32> = (0..36).map(|i| (i as f32 * 0.7).sin()).collect();
        normalize_rows(&mut rows, 6);
        let parts = vec!["A".into(), "B".into()];
        let held = Bank::from_rows(parts, grid, Rows::new(6, rows).unwrap(), vec![0.2; 6], sha256).unwrap();
        held.save(&bank).unwrap();
        Self { _folder: folder, model, bank }
    }

    /// The one line that refuses the model with a change to what its file says.
    fn refused_model(&self, forge: impl Fn(&mut SafeFile)) -> String {
        let good = SafeFile::load(&self.model, checkpoint::SCHEMA).unwrap();
        let mut forged = good.clone();
        forge(&mut forged);
        forged.save(&self.model, checkpoint::SCHEMA).unwrap();
        let error = Model::load(&self.model).unwrap_err().to_string();
        good.save(&self.model, checkpoint::SCHEMA).unwrap();
        assert!(error.starts_with(&self.model.display().to_string()) && !error.contains('\n'), "{error}");
        error
    }

    /// The same of the bank, its rows kept in a format.
    fn refused_bank(&self, rows: Precision, forge: impl Fn(&mut SafeFile)) -> String {
        let model = Model::load(&self.model).unwrap();
        let good = Bank::load(&self.bank, &model).unwrap();
        good.clone().with_precision(rows).unwrap().save(&self.bank).unwrap();
        Bank::load(&self.bank, &model).unwrap();
        let (mut forged, _) = SafeFile::load_as(&self.bank, bank::SCHEMA).unwrap();
        forge(&mut forged);
        forged.save_as(&self.bank, bank::SCHEMA, rows).unwrap();
        let error = Bank::load(&self.bank, &model).unwrap_err().to_string();
        good.save(&self.bank).unwrap();
        assert!(error.starts_with(&self.bank.display().to_string()) && !error.contains('\n'), "{error}");
        error
    }
}

/// Puts a value into a text entry of JSON, at a path of fields such as `/gap/sd`.
fn put(file: &mut SafeFile, entry: &str, at: &str, value: Value) {
    let text = file.text.iter_mut().find(|(name, _)| name == entry).map(|(_, text)| text).unwrap();
    let mut json: Value = serde_json::from_str(text).unwrap();
    *json.pointer_mut(at).unwrap() = value;
    *text = json.to_string();
}

#[test]
fn a_model_whose_weights_embed_nothing_is_refused() {
    let whole = Whole::new();
    let all =
        |value: f32| move |file: &mut SafeFile| file.tensors.iter_mut().for_each(|tensor| tensor.values.fill(value));
    for value in [0.0, 1e30, -1e30] {
        let error = whole.refused_model(all(value));
        assert!(["network: ", "running_var"].iter().any(|what| error.contains(what)), "{value}: {error}");
    }
    for value in [f32::NAN, f32::INFINITY] {
        let error = whole.refused_model(|file| file.tensors[2].values[0] = value);
        assert!(error.contains("expected finite weights"), "{value}: {error}");
    }
    // Convolutions without weights: the picture does not count any more.
    let blind = whole.refused_model(|file| {
        let is_conv = |name: &str| name.contains(".conv.");
        file.tensors.iter_mut().filter(|tensor| is_conv(&tensor.name)).for_each(|tensor| tensor.values.fill(0.0));
    });
    assert!(blind.contains("an embedding of each picture"), "{blind}");
    Model::load(&whole.model).unwrap();
}

#[test]
fn a_calibration_that_no_touches_give_is_refused_with_its_field() {
    let whole = Whole::new();
    for (at, values) in [
        ("/low_similarity", vec![json!(-2.0), json!(1e30), json!(null)]),
        ("/matched/sd", vec![json!(-1.0)]),
        ("/between_sensors", vec![json!(-1.0)]),
        ("/steepness", vec![json!(0.0), json!(-1.0)]),
        ("/own_by_edge/by_edge", vec![json!(-2.5), json!(1e30)]),
        ("/verifier/strain", vec![json!(-1.5), json!(2.0)]),
        ("/verifier/misfit", vec![json!(21.0), json!(-1e30)]),
        ("/prior/n_touches", vec![json!(-1.0)]),
        ("/prior/low_similarity", vec![json!(2.0)]),
    ] {
        for value in values {
            for entry in ["calibration", "peg_calibration"] {
                let error = whole.refused_model(|file| put(file, entry, at, value.clone()));
                let named = if value.is_null() { "entries of this version" } else { at.split('/').nth(1).unwrap() };
                assert!(error.contains(named) && (value.is_null() || error.contains(entry)), "{at} {value}: {error}");
            }
        }
    }
}

#[test]
fn match_odds_that_no_touches_give_are_refused_with_their_field() {
    let whole = Whole::new();
    for (at, values) in [
        ("/offset", vec![json!(null)]),
        ("/steepness", vec![json!(0.0), json!(-24.0)]),
        ("/own_distance", vec![json!(0.0), json!(-0.4)]),
        ("/rarity", vec![json!([]), json!([0.1, 0.1, 0.1, 0.1, 0.1])]),
        ("/rarity/2", vec![json!(null)]),
    ] {
        for value in values {
            for entry in ["match_odds", "peg_match_odds"] {
                let error = whole.refused_model(|file| put(file, entry, at, value.clone()));
                let named = if value.is_null() { "entries of this version" } else { at.split('/').nth(1).unwrap() };
                assert!(error.contains(named) && (value.is_null() || error.contains(entry)), "{at} {value}: {error}");
            }
        }
    }
}

#[test]
fn preprocessing_that_no_training_set_gives_is_refused_with_its_field() {
    let whole = Whole::new();
    for (at, value) in [
        ("/std/1", json!(0.0)),
        ("/std/0", json!(-3.0)),
        ("/field_of_view_mm/0", json!(0.0)),
        ("/field_of_view_mm/1", json!(-14.3)),
        ("/input_px/0", json!(0)),
        ("/input_px/0", json!(17)),
    ] {
        let error = whole.refused_model(|file| put(file, "preprocessing", at, value.clone()));
        let field = format!("preprocessing.{}", at.split('/').nth(1).unwrap());
        assert!(error.contains(&field), "{at} {value}: {error}");
    }
}

#[test]
fn a_bank_of_parts_without_names_of_their_own_is_refused() {
    let whole = Whole::new();
    for (name, word) in [("A", "'A' twice"), ("", "\"\""), (" ", "\" \""), ("B\u{1b}[2J", "B\\u{1b}[2J")] {
        let error = whole.refused_bank(Precision::F32, |file| put(file, "parts", "/1", name.into()));
        assert!(error.contains("parts: expected") && error.contains(word), "{name:?}: {error}");
    }
}

#[test]
fn a_bank_whose_rows_are_no_embeddings_is_refused() {
    let whole = Whole::new();
    let tensor = |file: &mut SafeFile, name: &str, change: &dyn Fn(&mut f32)| {
        let tensor = file.tensors.iter_mut().find(|tensor| tensor.name == name).unwrap();
        // Those of the last row.
        let n = tensor.values.len() / 6;
        tensor.values[5 * n..].iter_mut().for_each(change);
    };
    for factor in [0.0, 1.1, 1e18, 1e30] {
        let error = whole.refused_bank(Precision::F32, |file| tensor(file, "rows", &|value| *value *= factor));
        assert!(error.contains("row 5: expected an embedding of unit length"), "{factor}: {error}");
    }
    for (scale, word) in
        [(0.0, "row 5"), (-0.01, "bank scales"), (1e30, "row 5"), (f32::INFINITY, "bank scales"), (f32::NAN, "scales")]
    {
        let error = whole.refused_bank(Precision::I8, |file| tensor(file, "scales", &|value| *value = scale));
        assert!(error.contains(word), "{scale}: {error}");
    }
}
