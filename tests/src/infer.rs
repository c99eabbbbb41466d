//! Embeddings, banks and weights as a user makes them with `tactile-infer`.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tactile_data::dataset::store::Dataset;
use tactile_data::frame::picture;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_tests::programs::run;
use tactile_tests::samples::{Sample, text};

/// Writes two of the sample's peg touches as pictures into a folder; their names.
fn pictures(sample: &Sample, folder: &Path) -> [String; 2] {
    let pegs = Dataset::open(&sample.folder().join("pegs")).unwrap();
    [3, 31].map(|frame| {
        let path = folder.join(format!("touch-{frame}.png"));
        picture::write_png(&path, &pegs.frame(frame)).unwrap();
        text(path)
    })
}

/// Runs `tactile-infer embed` in the sample's folder and reads the rows it prints.
fn embedded(sample: &Sample, model: &str, images: &[String; 2], side: &str) -> Vec<Vec<f64>> {
    let [a, b] = images;
    let args = ["embed", a, b, "--model", model, "--no-contact", "pegs/no_contact.png", "--side", side, "--json"];
    let told: Value = serde_json::from_str(run("tactile-infer", sample.folder(), &args).done()).unwrap();
    let row = |image: &Value| image["embedding"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    told["images"].as_array().unwrap().iter().map(row).collect()
}

fn largest_difference(a: &[f64], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - f64::from(*b)).abs()).fold(0.0, f64::max)
}

#[test]
fn a_picture_is_embedded_as_its_recorded_frame_was() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let images = pictures(&sample, folder.path());
    let model = Model::load(&sample.folder().join("model/model.safetensors")).unwrap();
    let bank = Bank::load(&sample.folder().join("pegs.bank"), &model).unwrap();
    let pegs = Dataset::open(&sample.folder().join("pegs")).unwrap();
    let rows = embedded(&sample, "model/model.safetensors", &images, "peg");
    for (frame, row) in [3, 31].into_iter().zip(&rows) {
        let touch = pegs.touch(frame);
        let at = bank.row_at(touch.part.as_ref().unwrap(), &touch.part_from_sensor.unwrap()).unwrap();
        // The same sums, but in a batch of another size, and then rounded to 127 steps of the row's largest value.
        let largest = row.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
        assert!(largest_difference(row, &bank.row(at)) < 0.5 * largest / 127.0 + 1e-5, "frame {frame}");
    }
    // For people: a line an image, then the cosines, each image's with itself being one.
    let lines = ["embed", &images[0], &images[1], "--model", "model/model.safetensors"];
    let human = run("tactile-infer", sample.folder(), &[&lines[..], &["--no-contact", "pegs/no_contact.png"]].concat());
    let lines: Vec<_> = human.done().lines().map(|line| line.split_whitespace().collect::<Vec<_>>()).collect();
    assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [129, 129, 0, 6, 3, 3]);
    assert_eq!((lines[4][1], lines[5][2], lines[4][2]), ("1.000", "1.000", lines[5][1]));
}

#[test]
fn what_cannot_be_embedded_is_named() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let [image, _] = pictures(&sample, folder.path());
    let small = folder.path().join("small.png");
    let rest = picture::read(&sample.folder().join("pegs/no_contact.png")).unwrap();
    picture::write_png(&small, &picture::resize(&rest, [60, 50]).unwrap()).unwrap();
    let small = text(small);
    let without = run("tactile-infer", sample.folder(), &["embed", "--model", "model/model.safetensors", &image]);
    assert!(without.misused().contains("--no-contact"), "{without:#?}");
    let rest = ["--no-contact", "pegs/no_contact.png"];
    for (args, words) in [
        (vec!["none.png", rest[0], rest[1]], ["none.png", "No such file"]),
        (vec![&image, "--no-contact", "none.png"], ["none.png", "No such file"]),
        (vec![&image, &small, rest[0], rest[1]], ["small.png", "expected 80x60 pixels"]),
        (vec!["two.toml", rest[0], rest[1]], ["two.toml", "image"]),
        (vec![&image, rest[0], rest[1], "--device", "wgpu"], ["--device wgpu", "--features wgpu"]),
    ] {
        let ran = run(
            "tactile-infer",
            sample.folder(),
            &[&["embed", "--model", "model/model.safetensors"], &args[..]].concat(),
        );
        assert!(words.iter().all(|word| ran.failed().contains(word)), "{ran:#?}");
    }
}

#[test]
fn a_converted_model_is_another_half_the_size_and_nearly_as_good() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let images = pictures(&sample, folder.path());
    let half = text(folder.path().join("half.safetensors"));
    let model = "model/model.safetensors";
    run("tactile-infer", sample.folder(), &["convert", "--model", model, "--weights", "f16", "--out", &half]).done();
    let size = |path: &Path| fs::metadata(path).unwrap().len() as f64;
    assert!(size(Path::new(&half)) < 0.52 * size(&sample.folder().join(model)));
    let [full, narrow] = [model, half.as_str()].map(|model| embedded(&sample, model, &images, "hole"));
    for (full, narrow) in full.iter().zip(&narrow) {
        let cosine: f64 = full.iter().zip(narrow).map(|(a, b)| a * b).sum();
        // Weights half a unit in the eleventh digit off, through ten layers.
        assert!(cosine > 0.9999 && cosine < 1.0 + 1e-6, "{cosine}");
    }
    let refused = ["calibrate", "--model", &half, "--bank", "pegs.bank", "--holes", "holes"];
    assert!(run("tactile-infer", sample.folder(), &refused).failed().contains("a bank made by model"));
}

#[test]
fn a_bank_of_i8_is_a_quarter_of_the_size_with_nearly_the_same_cosines() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let model = "model/model.safetensors";
    let found = ["f32", "i8"].map(|rows| {
        let bank = text(folder.path().join(rows));
        let args = ["bank", "--model", model, "--data", "pegs", "--rows", rows, "--out", &bank];
        run("tactile-infer", sample.folder(), &args).done();
        let model = Model::load(&sample.folder().join(model)).unwrap();
        Bank::load(Path::new(&bank), &model).unwrap()
    });
    let [wide, narrow] = &found;
    assert_eq!(narrow.rows().n_bytes(), wide.n_rows() * (wide.dim() + 4));
    for row in 0..wide.n_rows() {
        // Steps of 1/127 of a row's largest value, which is below 0.5: half a step at each of 128 places at most.
        assert!((wide.rows().cosine(row, 5) - narrow.rows().cosine(row, 5)).abs() < 0.02, "row {row}");
    }
}
