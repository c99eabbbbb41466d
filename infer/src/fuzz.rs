//! Random damage to the files of a model and a bank: an error or what was saved, never a panic.
//!
//! Some dozens of cases by default; `PROPTEST_CASES` in the environment asks for more. Damage comes in two depths:
//! changed bytes, most of them caught by the checksum, and content that is saved anew with a checksum of its own.

use std::path::Path;
use std::sync::LazyLock;

use proptest::prelude::*;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Preprocessing, TactileImage};
use tactile_data::pose::grid::PoseGrid;

use crate::bank::rows::Rows;
use crate::bank::{self, Bank};
use crate::embedding::architecture::NetworkConfig;
use crate::embedding::checkpoint::{self, Checkpoint, Provenance};
use crate::embedding::device::DeviceKind;
use crate::embedding::model::Model;
use crate::error::Result;
use crate::safefile::SafeFile;

/// A tiny model and a bank of it, whole.
struct Whole {
    model: Model,
    checkpoint: Vec<u8>,
    bank: Vec<u8>,
    held: Bank,
}

static WHOLE: LazyLock<Whole> = LazyLock::new(|| {
    let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 3 };
    let network = config.init(3, &DeviceKind::Flex.tensor_device());
    let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
    let folder = tempfile::tempdir().unwrap();
    let [of_model, of_bank] = ["model", "bank"].map(|name| folder.path().join(name));
    let sha256 = checkpoint.save(&of_model).unwrap();
    let grid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };
    let mut rows: Vec<f32> = (0..18).map(|i| i as f32 / 18.0).collect();
    crate::bank::similarity::normalize_rows(&mut rows, 3);
    let held =
        Bank::from_rows(vec!["A".into(), "B".into()], grid, Rows::new(3, rows).unwrap(), vec![0.2; 6], sha256.clone())
            .unwrap();
    held.save(&of_bank).unwrap();
    Whole {
        model: Model::new(checkpoint, sha256, DeviceKind::Flex).unwrap(),
        checkpoint: std::fs::read(of_model).unwrap(),
        bank: std::fs::read(of_bank).unwrap(),
        held,
    }
});

/// One thing that happens to a file; places are shares of its length.
#[derive(Clone, Debug)]
enum Damage {
    Flip(f64, u8),
    Set(f64, u8),
    Cut(f64),
    Insert(f64, Vec<u8>),
    Remove(f64, usize),
    Swap(f64, f64, usize),
}

fn damage() -> impl Strategy<Value = Damage> {
    // Half of all damage is to the header: its length, JSON and text.
    let place = || prop_oneof![0.0..1.0_f64, 0.0..0.05_f64];
    prop_oneof![
        4 => (place(), 0..8_u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        4 => (place(), any::<u8>()).prop_map(|(at, byte)| Damage::Set(at, byte)),
        2 => place().prop_map(Damage::Cut),
        1 => (place(), prop::collection::vec(any::<u8>(), 1..20)).prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
        1 => (place(), 1..20_usize).prop_map(|(at, n)| Damage::Remove(at, n)),
        1 => (place(), place(), 1..40_usize).prop_map(|(a, b, n)| Damage::Swap(a, b, n)),
    ]
}

fn damaged(whole: &[u8], all: &[Damage]) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for damage in all {
        let n = bytes.len();
        let at = |share: f64| ((share * n as f64) as usize).min(n.saturating_sub(1));
        match damage {
            _ if n == 0 => {}
            Damage::Flip(place, bit) => bytes[at(*place)] ^= 1 << bit,
            Damage::Set(place, byte) => bytes[at(*place)] = *byte,
            Damage::Cut(place) => bytes.truncate(at(*place)),
            Damage::Insert(place, more) => drop(bytes.splice(at(*place)..at(*place), more.iter().copied())),
            Damage::Remove(place, many) => drop(bytes.drain(at(*place)..(at(*place) + many).min(n))),
            Damage::Swap(a, b, many) => (0..*many).for_each(|k| bytes.swap((at(*a) + k) % n, (at(*b) + k) % n)),
        }
    }
    bytes
}

/// Loads bytes as a file.
fn read<T>(bytes: &[u8], load: impl Fn(&Path) -> Result<T>) -> Result<T> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, bytes).unwrap();
    load(&path)
}

fn read_bank(bytes: &[u8]) -> Result<Bank> {
    read(bytes, |path| Bank::load(path, &WHOLE.model))
}

/// A loaded model embeds to finite rows, or says why not.
fn check_model(model: &Model) -> std::result::Result<(), TestCaseError> {
    let [width, height] = model.config().input_px;
    let planes = (0..3 * width * height).map(|i| (i as f32 * 0.7).sin()).collect();
    let image = TactileImage { size_px: [width, height], planes, edge_share: 0.5 };
    if let Ok(rows) = model.embed_holes(&[image]) {
        prop_assert!(rows.len() == model.dim() && rows.iter().all(|value| value.is_finite()));
        let square: f32 = rows.iter().map(|value| value * value).sum();
        prop_assert!(square == 0.0 || (square - 1.0).abs() < 1e-4);
    }
    let lows = [Side::Hole, Side::Peg].map(|side| model.calibration(side).map(|of| of.low_similarity));
    prop_assert!(lows.iter().flatten().all(|low| (-1.0..=1.0).contains(low)));
    Ok(())
}

fn check_bank(bank: &Bank) -> std::result::Result<(), TestCaseError> {
    prop_assert_eq!(bank.n_rows(), bank.parts().len() * bank.grid().len());
    prop_assert_eq!(bank.rows().len(), bank.n_rows());
    let lengths = (0..bank.n_rows()).map(|row| bank.row(row).iter().map(|value| value * value).sum::<f32>());
    prop_assert!(lengths.enumerate().all(|(row, square)| !bank.is_recorded(row) || (0.95..1.05).contains(&square)));
    let names: std::collections::BTreeSet<&String> = bank.parts().iter().collect();
    prop_assert!(names.len() == bank.parts().len() && names.iter().all(|name| !name.is_empty()));
    prop_assert!(bank.edge_shares().iter().all(|share| (0.0..=1.0).contains(share)));
    Ok(())
}

/// What a JSON number or text is replaced by.
fn odd() -> impl Strategy<Value = serde_json::Value> {
    let texts = [
        "0", "-1", "1", "4", "8", "16", "17", "30", "64", "1024", "4096", "5000", "1e200", "1e300", "1e-300", "\"\"",
        "null", "[]", "{}", "true", "1.5",
    ];
    prop::sample::select(texts.to_vec()).prop_map(|text| serde_json::from_str(text).unwrap())
}

/// Replaces the leaf of this number, counted cyclically.
fn replace_leaf(value: &mut serde_json::Value, number: usize, by: &serde_json::Value) {
    fn leaves<'a>(value: &'a mut serde_json::Value, found: &mut Vec<&'a mut serde_json::Value>) {
        match value {
            serde_json::Value::Array(items) => items.iter_mut().for_each(|item| leaves(item, found)),
            serde_json::Value::Object(items) => items.values_mut().for_each(|item| leaves(item, found)),
            leaf => found.push(leaf),
        }
    }
    let mut found = Vec::new();
    leaves(value, &mut found);
    if let Some(at) = number.checked_rem(found.len()) {
        *found.swap_remove(at) = by.clone();
    }
}

/// A change to what a file says, under a checksum that fits.
#[derive(Clone, Debug)]
enum Forgery {
    Leaf(usize, usize, serde_json::Value),
    Value(usize, usize, f32),
    /// A whole tensor times a number.
    Scale(usize, f32),
    Shape(usize, Vec<usize>),
    DropTensor(usize),
    DropText(usize),
    Rename(usize, String),
    Bytes(usize),
}

fn forgery() -> impl Strategy<Value = Forgery> {
    let value = prop::sample::select(vec![0.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, 1e-45]);
    let factor = prop::sample::select(vec![0.0, -1.0, 1e-30, 1e30]);
    prop_oneof![
        6 => (any::<usize>(), any::<usize>(), odd()).prop_map(|(entry, leaf, by)| Forgery::Leaf(entry, leaf, by)),
        3 => (any::<usize>(), any::<usize>(), value).prop_map(|(tensor, at, by)| Forgery::Value(tensor, at, by)),
        2 => (any::<usize>(), factor).prop_map(|(tensor, by)| Forgery::Scale(tensor, by)),
        2 => (any::<usize>(), prop::collection::vec(0..8_usize, 0..4)).prop_map(|(tensor, to)| Forgery::Shape(tensor, to)),
        1 => any::<usize>().prop_map(Forgery::DropTensor),
        1 => any::<usize>().prop_map(Forgery::DropText),
        1 => (any::<usize>(), ".{0,12}").prop_map(|(tensor, to)| Forgery::Rename(tensor, to)),
        1 => any::<usize>().prop_map(Forgery::Bytes),
    ]
}

/// The file with its forgeries under a fitting checksum; `None` where it could not even be saved.
fn forged(whole: &[u8], schema: &str, all: &[Forgery]) -> Option<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, whole).unwrap();
    let mut file = SafeFile::load(&path, schema).unwrap();
    for forgery in all {
        let (n_tensors, n_texts) = (file.tensors.len(), file.text.len());
        match forgery {
            Forgery::Leaf(entry, leaf, by) if n_texts > 0 => {
                let text = &mut file.text[entry % n_texts].1;
                let Ok(mut json) = serde_json::from_str(text) else { continue };
                replace_leaf(&mut json, *leaf, by);
                *text = json.to_string();
            }
            Forgery::DropText(entry) if n_texts > 0 => drop(file.text.remove(entry % n_texts)),
            Forgery::Value(tensor, at, by) if n_tensors > 0 => {
                let values = &mut file.tensors[tensor % n_tensors].values;
                let n = values.len().max(1);
                values.iter_mut().skip(at % n).take(1).for_each(|value| *value = *by);
            }
            Forgery::Scale(tensor, by) if n_tensors > 0 => {
                file.tensors[tensor % n_tensors].values.iter_mut().for_each(|value| *value *= by);
            }
            Forgery::Shape(tensor, to) if n_tensors > 0 => {
                let tensor = &mut file.tensors[tensor % n_tensors];
                tensor.values.resize(to.iter().product(), 0.5);
                tensor.shape.clone_from(to);
            }
            Forgery::DropTensor(tensor) if n_tensors > 0 => drop(file.tensors.remove(tensor % n_tensors)),
            Forgery::Rename(tensor, to) if n_tensors > 0 => file.tensors[tensor % n_tensors].name.clone_from(to),
            Forgery::Bytes(tensor) if n_tensors > 0 => {
                let tensor = file.tensors.remove(tensor % n_tensors);
                file.blobs.push((tensor.name, tensor.values.iter().map(|value| *value as u8).collect()));
            }
            _ => {}
        }
    }
    file.save(&path, schema).ok()?;
    std::fs::read(path).ok()
}

/// A quarter of what is asked for elsewhere: each case writes a file.
fn fewer() -> ProptestConfig {
    let asked = ProptestConfig::default();
    ProptestConfig { cases: asked.cases.div_ceil(4), ..asked }
}

proptest! {
    #![proptest_config(fewer())]

    #[test]
    fn fuzz_a_damaged_bank_is_refused_or_whole(all in prop::collection::vec(damage(), 1..4)) {
        match read_bank(&damaged(&WHOLE.bank, &all)) {
            // The checksum covers all that a bank holds.
            Ok(bank) => prop_assert_eq!(&bank, &WHOLE.held),
            Err(error) => prop_assert!(!error.to_string().contains('\n'), "{}", error),
        }
    }

    #[test]
    fn fuzz_a_damaged_checkpoint_is_refused_or_whole(all in prop::collection::vec(damage(), 1..4)) {
        match read(&damaged(&WHOLE.checkpoint, &all), Model::load) {
            Ok(model) => prop_assert_eq!(model.sha256(), WHOLE.model.sha256()),
            Err(error) => prop_assert!(!error.to_string().contains('\n'), "{}", error),
        }
    }

    #[test]
    fn fuzz_a_forged_bank_is_refused_or_a_bank(all in prop::collection::vec(forgery(), 1..4)) {
        if let Some(bytes) = forged(&WHOLE.bank, bank::SCHEMA, &all)
            && let Ok(bank) = read_bank(&bytes)
        {
            check_bank(&bank)?;
        }
    }

    #[test]
    fn fuzz_a_forged_checkpoint_is_refused_or_a_model(all in prop::collection::vec(forgery(), 1..4)) {
        if let Some(bytes) = forged(&WHOLE.checkpoint, checkpoint::SCHEMA, &all)
            && let Ok(model) = read(&bytes, Model::load)
        {
            check_model(&model)?;
        }
    }
}
