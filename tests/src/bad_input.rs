//! Bad input through the programs: one line that names what is wrong, an exit code, nothing lost.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use tactile_data::file::output_lock::OutputLock;
use tactile_infer::bank::SCHEMA;
use tactile_infer::safefile::SafeFile;
use tactile_tests::programs::{Ran, path, run};
use tactile_tests::samples::{self, FRAME_PX, Sample, text};

/// Runs a program in the sample's folder with a command line of plain words.
fn shell(sample: &Sample, line: &str) -> Ran {
    let words: Vec<_> = line.split_whitespace().collect();
    run(words[0], sample.folder(), &words[1..])
}

/// Asserts that a program failed with one line that holds each of the words.
fn names(ran: &Ran, words: &[&str]) {
    let line = ran.failed();
    for word in words {
        assert!(line.contains(word), "no {word:?} in {ran:#?}");
    }
}

/// Every file below a folder with its content.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(contents(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

/// Changes a file as a text; it must hold what is replaced.
fn replace(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "no {from:?} in {}", file.display());
    fs::write(file, text.replace(from, to)).unwrap();
}

/// Spoils a copy of the sample's MAZE dataset, and asserts that looking at it and training on it both
/// fail with one line that holds the words.
fn spoilt_dataset(spoil: impl FnOnce(&Path), words: &[&str]) {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let copy = sample.copy("maze", folder.path());
    spoil(&copy);
    let copy = text(copy);
    names(&run("tactile-data", folder.path(), &["inspect", &copy]), words);
    names(&run("tactile-train", folder.path(), &["--data", &copy, "--out", "model"]), words);
    assert!(!folder.path().join("model").exists());
}

#[test]
fn a_dataset_cut_short_is_refused() {
    let cut = |dataset: &Path| {
        let frames = fs::OpenOptions::new().write(true).open(dataset.join("frames.npy")).unwrap();
        frames.set_len(frames.metadata().unwrap().len() - 1).unwrap();
    };
    let n_bytes = 128 + 48 * 80 * 60 * 3;
    spoilt_dataset(cut, &["frames.npy", &format!("{n_bytes} bytes"), &format!("{} bytes", n_bytes - 1)]);
}

#[test]
fn a_dataset_with_a_wrong_checksum_is_refused() {
    for file in ["frames.npy", "index.jsonl"] {
        let change = |dataset: &Path| {
            let path = dataset.join(file);
            let mut bytes = fs::read(&path).unwrap();
            *bytes.last_mut().unwrap() ^= 1;
            fs::write(&path, bytes).unwrap();
        };
        spoilt_dataset(change, &[file, "SHA-256"]);
    }
}

#[test]
fn a_dataset_with_frames_of_another_size_is_refused() {
    let declare = |dataset: &Path| {
        let meta = dataset.join("meta.json");
        let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&meta).unwrap()).unwrap();
        json["frame_px"] = serde_json::json!([60, 80]);
        fs::write(&meta, json.to_string()).unwrap();
    };
    spoilt_dataset(declare, &["frames.npy", "(48, 80, 60, 3)", "(48, 60, 80, 3)"]);
    let rest = |dataset: &Path| RgbImage::new(40, 30).save(dataset.join("no_contact.png")).unwrap();
    spoilt_dataset(rest, &["no_contact.png", "80x60", "40x30"]);
}

#[test]
fn a_dataset_without_its_no_contact_frame_is_refused() {
    spoilt_dataset(|dataset| fs::remove_file(dataset.join("no_contact.png")).unwrap(), &["no_contact.png"]);
}

#[test]
fn a_dataset_of_another_version_is_refused() {
    let later = |dataset: &Path| replace(&dataset.join("meta.json"), "/dataset/1", "/dataset/2");
    spoilt_dataset(later, &["meta.json", "tactile-filter/dataset/1", "tactile-filter/dataset/2"]);
}

#[test]
fn a_bank_made_by_another_model_is_refused() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (other, out) = (text(folder.path().join("other")), text(folder.path().join("evaluation")));
    shell(&sample, &format!("tactile-train --data maze --out {other} --seed 2 --steps 1 --batch 8")).done();
    let with = format!("--model {other}/model.safetensors --bank pegs.bank");
    for line in [
        format!("tactile-filter evaluate {with} --scene two.toml --out {out}"),
        format!("tactile-filter replay {with} --data holes"),
    ] {
        names(&shell(&sample, &line), &["pegs.bank", "a bank made by model", &sample.model_sha256[..12]]);
    }
    assert!(!folder.path().join("evaluation").exists());
}

#[test]
fn a_checkpoint_of_another_version_or_cut_short_is_refused() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let good = fs::read(sample.folder().join("model/model.safetensors")).unwrap();
    let (now, later) = (b"tactile-filter/checkpoint/2", b"tactile-filter/checkpoint/3");
    let at = good.windows(now.len()).position(|bytes| bytes == now).unwrap();
    let mut of_later = good.clone();
    of_later[at..at + later.len()].copy_from_slice(later);
    let mut changed = good.clone();
    *changed.last_mut().unwrap() ^= 1;
    let model = folder.path().join("model.safetensors");
    let bank = folder.path().join("pegs.bank");
    fs::write(&bank, "precious").unwrap();
    for (bytes, words) in [
        (&of_later[..], ["tactile-filter/checkpoint/2", "tactile-filter/checkpoint/3"]),
        (&good[..good.len() - 1], ["a whole safetensors file", "got"]),
        (&changed, ["checksum", &sample.model_sha256]),
        (&[], ["a whole safetensors file", "got"]),
    ] {
        fs::write(&model, bytes).unwrap();
        let args = ["bank", "--model", &text(model.clone()), "--data", "pegs", "--out", &text(bank.clone())];
        names(&run("tactile-infer", sample.folder(), &args), &[&["model.safetensors"], &words[..]].concat());
    }
    assert_eq!(fs::read(&bank).unwrap(), b"precious");
}

#[test]
fn a_scene_with_an_unknown_part_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("bad.toml");
    for (from, to, word) in [
        ("\"TX\"", "\"T\u{e000}\"", "\u{e000}"),
        ("\"TX\"", "\"TT\"", "'T' twice"),
        ("[parts.letters]", "[parts.gears]", "gears"),
        ("[reach]", "[grid]", "grid"),
    ] {
        fs::write(&scene, samples::SCENE.replace(from, to)).unwrap();
        let ran = run("tactile-data", folder.path(), &["generate", "--scene", "bad.toml", "--out", "out"]);
        names(&ran, &["bad.toml", word]);
    }
    let misspelt = run("tactile-data", folder.path(), &["generate", "--scene", "alphabet-smal", "--out", "out"]);
    names(&misspelt, &["alphabet-smal", "alphabet-small,"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only the scene");
}

/// Imports frames of one touch, one a picture, with the sample's own frame at rest; the dataset.
fn recorded(sample: &Sample, folder: &Path, frames: &[RgbImage]) -> String {
    let pictures = folder.join("pictures");
    fs::create_dir(&pictures).unwrap();
    for (number, frame) in frames.iter().enumerate() {
        frame.save(pictures.join(format!("touch{number}.png"))).unwrap();
    }
    let (out, rest) = (text(folder.join("recorded")), sample.at("pegs/no_contact.png"));
    run("tactile-data", folder, &["import", &text(pictures), "--no-contact", &rest, "--out", &out]).done();
    out
}

#[test]
fn a_frame_that_shows_nothing_is_named() {
    let sample = Sample::shared();
    let rest = image::open(sample.at("pegs/no_contact.png")).unwrap().to_rgb8();
    for (value, word) in [(0, "a dark one"), (255, "a saturated one"), (120, "a uniform one")] {
        let folder = tempfile::tempdir().unwrap();
        let dark = RgbImage::from_pixel(80, 60, Rgb([value; 3]));
        let data = recorded(&sample, folder.path(), &[rest.clone(), dark.clone()]);
        let line = format!("tactile-filter replay --model model/model.safetensors --bank pegs.bank --data {data}");
        names(&shell(&sample, &line), &["frame 1", word]);
        // Inspecting the recording reports it and continues.
        let inspected = run("tactile-data", folder.path(), &["inspect", &data]);
        assert!(
            inspected.done().lines().any(|line| line.contains("frame 1: frame: expected a") && line.contains(word)),
            "{inspected:?}"
        );
        // As the frame at rest it spoils the whole recording.
        dark.save(Path::new(&data).join("no_contact.png")).unwrap();
        names(&shell(&sample, &line), &["no-contact frame", word]);
    }
}

#[test]
fn frames_of_another_size_are_named() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let pictures = folder.path().join("pictures");
    fs::create_dir(&pictures).unwrap();
    fs::copy(sample.at("pegs/no_contact.png"), pictures.join("a.png")).unwrap();
    RgbImage::new(64, 48).save(pictures.join("b.png")).unwrap();
    let rest = sample.at("pegs/no_contact.png");
    let import = ["import", "pictures", "--no-contact", &rest, "--out", "recorded"];
    let ran = run("tactile-data", folder.path(), &import);
    let last = ran.stderr.lines().last().unwrap();
    assert!(ran.code == Some(1) && ["b.png", "80x60", "64x48"].iter().all(|word| last.contains(word)), "{ran:?}");
    assert!(!folder.path().join("recorded").exists());
    // Too small for the network.
    fs::remove_file(pictures.join("b.png")).unwrap();
    run("tactile-data", folder.path(), &[&import[..], &["--frame-px", "20x15"]].concat()).done();
    let data = text(folder.path().join("recorded"));
    let line = format!("tactile-filter replay --model model/model.safetensors --bank pegs.bank --data {data}");
    names(&shell(&sample, &line), &["20x15", "40x30"]);
}

#[test]
fn an_existing_dataset_is_never_written_over() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    sample.copy("maze", folder.path());
    let before = contents(folder.path());
    let generate = ["generate", "--scene", "maze", "--pairs", "24", "--boards", "3", "--frame-px", FRAME_PX];
    let import = ["import", &sample.at("pegs/no_contact.png"), "--no-contact", "1"];
    for args in [&generate[..], &import[..]] {
        names(&run("tactile-data", folder.path(), &[args, &["--out", "maze"]].concat()), &["maze", "an existing file"]);
    }
    assert!(before == contents(folder.path()));
}

#[test]
fn an_output_is_checked_before_the_work() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let (maze, rest) = (text(sample.copy("maze", folder.path())), "maze/no_contact.png");
    let before = contents(folder.path());
    let render = "tactile-data render letter:A:12 --frame-px 80x60";
    for (line, words) in [
        (format!("tactile-data inspect {maze} --sheet {maze}/frames.npy"), ["frames.npy", "a file of its own"]),
        (format!("tactile-data inspect {maze} --sheet nowhere/sheet.png"), ["nowhere/sheet.png", "No such file"]),
        (format!("{render} --no-contact {rest} --out {rest}"), ["no_contact.png", "a file of its own"]),
        (format!("{render} --out a.png --at-rest-out a.png"), ["a.png", "a file of its own"]),
        (
            format!("tactile-data compare {rest} {rest} --no-contact {rest} {rest} --out {rest}"),
            ["no_contact.png", "a file of its own"],
        ),
    ] {
        let args: Vec<_> = line.split_whitespace().skip(1).collect();
        names(&run("tactile-data", folder.path(), &args), &words);
    }
    assert!(before == contents(folder.path()));
}

#[test]
fn no_program_writes_over_what_it_reads() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for file in ["model/model.safetensors", "pegs.bank", "two.toml"] {
        fs::copy(sample.folder().join(file), at.join(Path::new(file).file_name().unwrap())).unwrap();
    }
    sample.copy("pegs", at);
    fs::create_dir(at.join("old")).unwrap();
    fs::copy(at.join("pegs.bank"), at.join("old/evaluation.json")).unwrap();
    fs::create_dir(at.join("site")).unwrap();
    fs::write(at.join("site/report.html"), "precious").unwrap();
    let before = contents(at);
    let own = "a file of its own";
    for (line, words) in [
        (
            "tactile-infer bank --model model.safetensors --data pegs --out model.safetensors",
            ["model.safetensors", own],
        ),
        ("tactile-infer bank --model model.safetensors --data pegs --out pegs/frames.npy", ["frames.npy", own]),
        ("tactile-infer bank --model model.safetensors --scene two.toml --out two.toml", ["two.toml", own]),
        ("tactile-infer bank --model model.safetensors --scene two.toml#0+1 --out two.toml", ["two.toml", own]),
        (
            "tactile-infer convert --model model.safetensors --weights f16 --out model.safetensors",
            ["model.safeten", own],
        ),
        (
            "tactile-infer calibrate --model model.safetensors --bank pegs.bank --holes pegs --out pegs.bank",
            ["pegs.bank", own],
        ),
        (
            "tactile-infer embed pegs/no_contact.png --model model.safetensors --no-contact pegs/no_contact.png \
             --dump-input pegs/no_contact.png",
            ["no_contact.png", own],
        ),
        (
            "tactile-filter evaluate --model model.safetensors --bank old/evaluation.json --scene two.toml --out old",
            ["evaluation.json", own],
        ),
        (
            "tactile-filter evaluate --model model.safetensors --bank pegs.bank --scene two.toml --out site",
            ["report.html", "a page of something else"],
        ),
    ] {
        let args: Vec<_> = line.split_whitespace().collect();
        names(&run(args[0], at, &args[1..]), &words);
    }
    assert!(before == contents(at));
}

#[test]
fn sensors_that_say_nothing_of_each_other_are_named() {
    let sample = Sample::shared();
    let calibrate = "tactile-infer calibrate --model model/model.safetensors --bank pegs.bank --out never.safetensors";
    names(&shell(&sample, &format!("{calibrate} --holes holes --holes holes")), &["--holes", "holes again"]);
    names(&shell(&sample, &format!("{calibrate} --holes holes --holes pegs")), &["pegs", "holes that show an edge"]);
    for flag in ["--drawn-sensor", "--drawn-light"] {
        let line = format!("tactile-data generate --scene maze {flag} 1 --out never");
        names(&shell(&sample, &line), &[flag, "MAZE boards have sensors of their own"]);
    }
}

#[test]
fn a_calibration_names_what_its_source_lacks() {
    let sample = Sample::shared();
    for (line, words) in [
        ("calibrate table.npz", ["table.npz", "--frame-px"]),
        ("calibrate maze", ["maze", "--ball-mm"]),
        ("calibrate maze --frame-px 640x480", ["maze", "ends in npz"]),
    ] {
        names(&shell(&sample, &format!("tactile-data {line} --px-per-mm 20 --out never.toml")), &words);
    }
}

#[test]
fn an_output_that_cannot_be_written_is_found_before_the_work() {
    let sample = Sample::shared();
    let with = "--model model/model.safetensors --bank pegs.bank --scene two.toml";
    // One line of error and none of progress: nothing was done before.
    for line in [
        "tactile-infer bank --model model/model.safetensors --data pegs --out two.toml/pegs.bank".to_owned(),
        "tactile-infer calibrate --model model/model.safetensors --bank pegs.bank --holes holes --out two.toml/m"
            .into(),
        "tactile-infer convert --model model/model.safetensors --weights f16 --out two.toml/m".into(),
        format!("tactile-filter evaluate {with} --out two.toml"),
        format!("tactile-filter evaluate {with} --shard 1/2 --out two.toml"),
        format!("tactile-filter assemble {with} --out two.toml"),
        "tactile-filter tradeoff --model model/model.safetensors --scene two.toml --out two.toml".into(),
        "tactile-filter reproduction model --out two.toml/page.html".into(),
    ] {
        names(&shell(&sample, &line), &["two.toml"]);
    }
}

#[test]
fn a_forged_bank_is_named() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let forged = folder.path().join("forged.bank");
    let (good, rows) = SafeFile::load_as(&sample.folder().join("pegs.bank"), SCHEMA).unwrap();
    let spoilt = |spoil: &dyn Fn(&mut SafeFile)| {
        let mut file = good.clone();
        spoil(&mut file);
        file.save_as(&forged, SCHEMA, rows).unwrap();
        let line =
            format!("tactile-filter replay --model model/model.safetensors --bank {} --data holes", forged.display());
        shell(&sample, &line)
    };
    names(&spoilt(&|file| file.text.retain(|(key, _)| key != "grid")), &["forged.bank", "grid"]);
    names(&spoilt(&|file| file.text.retain(|(key, _)| key != "model_sha256")), &["forged.bank", "model_sha256"]);
    names(&spoilt(&|file| file.tensors.retain(|tensor| tensor.name != "rows")), &["forged.bank", "rows"]);
    names(&spoilt(&|file| file.tensors[0].values[0] = f32::NAN), &["forged.bank"]);
}

/// A link to an endless device, a pipe that nobody writes to, a folder and a hole of 6 GB in the place of each file
/// that a program reads: one line that names it, at once.
#[test]
#[cfg(unix)]
fn what_is_no_file_of_its_kind_is_named_and_not_read() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let maze = text(sample.copy("maze", at));
    fs::copy(sample.at("pegs/no_contact.png"), at.join("rest.png")).unwrap();
    let drawing = "name = \"drawn\"\n[[parts.files]]\nname = \"p\"\npeg = \"odd.svg\"\n[reach]\nxy_half_mm = 4.0\n\
                   xy_step_mm = 4.0\ntheta_half_deg = 0.0\ntheta_step_deg = 30.0\n";
    fs::write(at.join("drawn.toml"), drawing).unwrap();
    for (way, kind) in [("zero", "a device"), ("pipe", "a pipe"), ("folder", "a folder"), ("hole", "6442450944")] {
        for (name, line) in [
            ("odd.png", "tactile-data import odd.png --no-contact rest.png --out never".to_owned()),
            ("odd.png", "tactile-data import rest.png --no-contact odd.png --out never".into()),
            ("odd.csv", "tactile-data import rest.png --index odd.csv --no-contact rest.png --out never".into()),
            ("odd.toml", "tactile-data generate --scene odd.toml --out never".into()),
            ("odd.svg", "tactile-data generate --scene drawn.toml --out never".into()),
            ("odd.stl", "tactile-data render odd.stl --out never.png".into()),
            ("odd.npy", "tactile-data render odd.npy --map-mm-per-px 0.1,0.1 --out never.png".into()),
            ("odd.cal", "tactile-data render letter:A:12 --calibration odd.cal --out never.png".into()),
            ("maze/meta.json", format!("tactile-data inspect {maze}")),
            ("maze/index.jsonl", format!("tactile-data inspect {maze}")),
            ("maze/no_contact.png", format!("tactile-data inspect {maze}")),
            ("odd.model", format!("tactile-infer bank --model odd.model --data {maze} --out never")),
            ("odd.json", "tactile-filter merge odd.json --out never".into()),
            ("odd.train", format!("tactile-train --data {maze} --config odd.train --out never")),
        ] {
            let (place, kept) = (at.join(name), at.join("kept"));
            if place.exists() {
                fs::rename(&place, &kept).unwrap();
            }
            match way {
                "zero" => std::os::unix::fs::symlink("/dev/zero", &place).unwrap(),
                "pipe" => assert!(std::process::Command::new("mkfifo").arg(&place).status().unwrap().success()),
                "folder" => fs::create_dir(&place).unwrap(),
                _ => fs::File::create(&place).unwrap().set_len(6 << 30).unwrap(),
            }
            let args: Vec<_> = line.split_whitespace().collect();
            let ran = run(args[0], at, &args[1..]);
            // A folder of pictures may well be imported; this one has none. A hole is no header of a model.
            let words = match (way, name) {
                ("folder", "odd.png") if line.contains("import odd.png") => "at least one",
                ("folder", "odd.json") => "shard-I-of-N.json",
                ("hole", "odd.model") => "a whole safetensors file",
                _ => kind,
            };
            names(&ran, &[Path::new(name).file_name().unwrap().to_str().unwrap(), words]);
            if way == "folder" {
                fs::remove_dir(&place).unwrap()
            } else {
                fs::remove_file(&place).unwrap()
            }
            if kept.exists() {
                fs::rename(&kept, &place).unwrap();
            }
        }
    }
    assert!(!at.join("never").exists() && !at.join("never.png").exists());
}

/// Two runs are given one name: the second says so at once, and neither leaves a lock.
#[test]
fn an_output_has_one_writer_at_a_time() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path().join("out"));
    let with = "--model model/model.safetensors --bank pegs.bank";
    let locked = [
        ("out", format!("tactile-infer bank --model model/model.safetensors --data pegs --out {out}")),
        ("out", format!("tactile-infer convert --model model/model.safetensors --weights f16 --out {out}")),
        ("out", format!("tactile-infer calibrate {with} --holes holes --out {out}")),
        ("out/report.html", format!("tactile-filter evaluate {with} --scene two.toml --out {out}")),
        ("out/shard-1-of-2.json", format!("tactile-filter evaluate {with} --scene two.toml --shard 1/2 --out {out}")),
        ("out/report.html", format!("tactile-filter assemble {with} --scene two.toml --out {out}")),
        (
            "out/tradeoff.html",
            format!("tactile-filter tradeoff --model model/model.safetensors --scene two.toml --out {out}"),
        ),
        ("out", format!("tactile-data inspect maze --sheet {out}")),
        ("out", format!("tactile-data render letter:A:12 --out {out}")),
        ("out.npy", format!("tactile-data render letter:A:12 --out {out} --heights-out {out}.npy")),
        ("out", format!("tactile-data export maze --to folder --out {out}")),
        ("out/model.safetensors", format!("tactile-train --data maze --out {out}")),
    ];
    for (file, line) in locked {
        let file = folder.path().join(file);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        let first = OutputLock::take(&file).unwrap();
        names(&shell(&sample, &line), &[&*text(file.clone()), "another run at work"]);
        drop(first);
        if file.parent().unwrap() != folder.path() {
            fs::remove_dir_all(file.parent().unwrap()).unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{line}");
    }
    // A lock file of a run that was killed locks nothing, and goes.
    fs::write(folder.path().join("out.lock"), "").unwrap();
    shell(&sample, &format!("tactile-infer convert --model model/model.safetensors --weights f16 --out {out}")).done();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// What files say of themselves reaches the terminal with its control characters escaped.
#[test]
fn control_characters_of_files_and_names_are_never_printed() {
    let sample = Sample::shared();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let odd = "a\u{1b}[2J\u{9b}\u{202e}b";
    let raw = |ran: &Ran| [&ran.stdout, &ran.stderr].iter().any(|text| text.contains(['\u{1b}', '\u{9b}', '\u{202e}']));
    // A path, an error that quotes a file, a field of a dataset.
    fs::copy(sample.at("pegs/no_contact.png"), at.join(format!("{odd}.png"))).unwrap();
    fs::copy(sample.at("pegs/no_contact.png"), at.join("rest.png")).unwrap();
    let import = run("tactile-data", at, &["import", &format!("{odd}.png"), "--no-contact", "rest.png", "--out", odd]);
    assert!(!raw(&import) && import.stderr.contains("\\u{1b}"), "{import:?}");
    fs::write(at.join("raw.csv"), format!("file,{odd}\nrest.png,1\n")).unwrap();
    for line in [
        "import rest.png --index raw.csv --no-contact rest.png --out never",
        "generate --scene none\u{1b}.toml --out never",
    ] {
        let ran = run("tactile-data", at, &line.split_whitespace().collect::<Vec<_>>());
        assert!(!raw(&ran) && ran.failed().contains("\\u{1b}"), "{ran:?}");
    }
    let maze = sample.copy("maze", at);
    let about = maze.join("meta.json");
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(&about).unwrap()).unwrap();
    json["source"] = odd.into();
    fs::write(&about, json.to_string()).unwrap();
    for args in [&["inspect", "maze"][..], &["inspect", "maze", "--json"]] {
        let ran = run("tactile-data", at, args);
        assert!(!raw(&ran) && ran.done().contains("202e"), "{ran:?}");
    }
}

#[test]
fn a_misspelt_name_is_answered_with_the_nearest() {
    let sample = Sample::shared();
    let with = "--model model/model.safetensors --bank pegs.bank";
    for (line, meant) in [
        (format!("tactile-filter evaluate {with} --scene two.toml --out never --engines exat"), "'exact'"),
        (format!("tactile-filter evaluate {with} --scene two.toml --out never --actions ramdom"), "'random'"),
        (format!("tactile-filter evaluate {with} --scene two.toml --out never --poses ongrid"), "'on-grid'"),
        (format!("tactile-filter replay {with} --data holes --device flx"), "'flex'"),
        ("tactile-infer bank --model m --data pegs --out never --rows f166".into(), "'f16'"),
    ] {
        let ran = shell(&sample, &line);
        assert!(ran.misused().contains("similar value") && ran.misused().contains(meant), "{ran:?}");
    }
    names(
        &shell(&sample, &format!("tactile-filter evaluate {with} --scene alphabet-smal --out never")),
        &["did you mean alphabet-small?"],
    );
}

#[test]
fn a_budget_that_is_none_is_refused_at_once() {
    let sample = Sample::shared();
    let number = "expected a number above 0";
    let limits = [("ms", number), ("mb", number), ("s", number), ("touches", "expected a whole number above 0")];
    for (limit, expected) in limits {
        for value in ["nan", "inf", "0", "-1"] {
            let line = format!("tactile-filter replay --model m --bank b --data holes --budget {limit}={value}");
            let ran = shell(&sample, &line);
            assert!(ran.misused().contains(&format!("{limit}: {expected}")), "{ran:?}");
        }
    }
}

#[test]
fn what_no_machine_holds_is_refused_at_once_with_what_it_needs() {
    let sample = Sample::shared();
    let with = "--model model/model.safetensors --bank pegs.bank";
    let evaluate = format!("evaluate {with} --scene two.toml --out never");
    for (line, words) in [
        (format!("{evaluate} --touches 1000000000"), ["--touches", "1000000000", "512.0 TB of memory"]),
        (format!("{evaluate} --episodes 1000000000000"), ["--episodes", "1000000000000", "PB of memory"]),
        (
            format!("{evaluate} --engines particle --set n_particles=1000000000000"),
            ["engine.n_particles", "1000000000000", "1 to 1000000"],
        ),
        (format!("{evaluate} --set n_draws=1000000000000"), ["episode.n_draws", "1000000000000", "1 to 100000"]),
        (format!("{evaluate} --set n_suppositions=1000000"), ["episode.n_suppositions", "1000000", "1 to 10000"]),
        (format!("{evaluate} --set steepness=-1e300"), ["touch_model.steepness", "a positive number", "got -1e300"]),
        (format!("replay {with} --data holes --set max_touches=1000000"), ["max_touches", "1000000", "1 to 1000"]),
        (
            format!("assemble {with} --scene two.toml --out never --trials 1000000000000"),
            ["--trials", "1000000000000", "512.0 TB"],
        ),
        (
            "tradeoff --model model/model.safetensors --out never --episodes 1000000000000".into(),
            ["--episodes", "1000000000000", "PB"],
        ),
    ] {
        names(&shell(&sample, &format!("tactile-filter {line}")), &words);
    }
    let solids: Vec<String> = (0..30_000).map(|i| format!("\"cylinder:{}\"", 4.0 + f64::from(i) * 1e-3)).collect();
    let reach = "[reach]\nxy_half_mm = 4.0\nxy_step_mm = 4.0\ntheta_half_deg = 0.0\ntheta_step_deg = 30.0\n";
    let many = format!("name = \"many\"\n[parts.solids]\nnames = [{}]\n{reach}", solids.join(", "));
    let folder = tempfile::tempdir().unwrap();
    let scene = text(folder.path().join("many.toml"));
    fs::write(&scene, many).unwrap();
    let bank = "tactile-infer bank --model model/model.safetensors --scene two.toml --out never --xy-step-mm 0.0001";
    names(&shell(&sample, bank), &["reach", "at most 1e7 poses"]);
    for (line, words) in [
        ("--scene maze --pairs 999999999999999999", ["room for 1999999999999999998 frames of 57.6 kB", "free"]),
        ("--scene alphabet-small --anywhere 9999999999999999999", ["frames of 57.6 kB", "free"]),
        ("--scene maze --boards 1000000000", ["parts.maze.n_boards", "at most 100000"]),
        ("--scene maez", ["maez", "did you mean maze?"]),
        (&*format!("--scene {scene}"), ["at most 10000 parts, got 30000 parts and 540000 touches", "GB of memory"]),
    ] {
        names(&shell(&sample, &format!("tactile-data generate {line} --out never")), &words);
    }
    assert!(!sample.folder().join("never").exists());
}

#[test]
fn a_flag_that_would_do_nothing_is_refused() {
    let sample = Sample::shared();
    let with = "--model model/model.safetensors --bank pegs.bank";
    for flag in ["--other-sensor", "--frontier f.json"] {
        let ran = shell(&sample, &format!("tactile-filter replay {with} --data holes {flag}"));
        assert!(ran.misused().contains(flag.split(' ').next().unwrap()), "{ran:?}");
    }
    for (line, words) in [
        (
            format!("tactile-filter evaluate {with} --scene two.toml --out never --engines exact --set n_particles=9"),
            "--set n_particles: expected the engine particle or paper",
        ),
        (
            format!("tactile-filter replay {with} --data holes --set n_draws=8"),
            "--set n_draws: expected a command that",
        ),
        (format!("tactile-filter replay {with} --data holes --set min_separation_mm=3"), "--set min_separation_mm"),
        (
            format!("tactile-filter evaluate {with} --scene two.toml --out never --set seed=3"),
            "--set seed: expected --seeds",
        ),
        ("tactile-data generate --scene maze --sides peg --out never".into(), "--sides"),
        ("tactile-data import pegs --side peg --out never".into(), "--side: expected a bag"),
        (format!("tactile-filter evaluate {with} --scene two.toml --out never --absent --stories 2"), "--stories"),
    ] {
        names(&shell(&sample, &line), &[words]);
    }
    assert!(!sample.folder().join("never").exists());
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let sample = Sample::shared();
    for line in [
        "tactile-data inspect nowhere",
        "tactile-data import nowhere --out never",
        "tactile-data generate --scene nowhere.toml --out never",
        "tactile-train --data nowhere --out never",
        "tactile-infer bank --model nowhere --data pegs --out never",
        "tactile-infer bank --model model/model.safetensors --data nowhere --out never",
        "tactile-infer match --model model/model.safetensors --pegs pegs --holes nowhere",
        "tactile-filter evaluate --model model/model.safetensors --bank nowhere --scene two.toml --out never",
        "tactile-filter assemble --model model/model.safetensors --bank pegs.bank --scene nowhere.toml --out never",
        "tactile-filter replay --model model/model.safetensors --bank pegs.bank --data nowhere",
    ] {
        names(&shell(&sample, line), &["nowhere"]);
    }
    assert!(!sample.folder().join("never").exists());
}

#[test]
fn misuse_exits_2_and_names_the_word() {
    let sample = Sample::shared();
    for (line, word) in [
        ("tactile-train --data maze --out never --device cuda", "'cuda'"),
        ("tactile-infer bank --model m --data pegs --out never --device cuda", "'cuda'"),
        ("tactile-filter replay --model m --bank b --data holes --device cuda", "'cuda'"),
        ("tactile-data generate --scene maze", "--out"),
        ("tactile-data generate --scene maze --out never --frame-px 80", "WIDTHxHEIGHT"),
        ("tactile-data dance", "'dance'"),
        ("tactile-train --data maze --out never --speed 3", "'--speed'"),
        ("tactile-filter evaluate --episodes many", "'many'"),
        ("tactile-filter tradeoff --model m --out never --settings 0", "'0'"),
    ] {
        let ran = shell(&sample, line);
        assert!(ran.misused().contains(word), "{ran:?}");
    }
    for program in ["tactile-data", "tactile-train", "tactile-infer", "tactile-filter"] {
        assert!(shell(&sample, program).misused().contains("Usage"));
        assert!(shell(&sample, &format!("{program} --help")).done().contains("Usage"));
    }
    assert!(!sample.folder().join("never").exists());
}

#[test]
fn a_reader_that_goes_away_ends_a_program_in_silence() {
    let sample = Sample::shared();
    for line in [
        "tactile-data inspect maze",
        "tactile-infer match --model model/model.safetensors --pegs pegs --holes holes --limit 2",
        "tactile-filter replay --model model/model.safetensors --bank pegs.bank --data holes",
        "tactile-filter merge nowhere --help",
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let [program, words @ ..] = &line.split_whitespace().collect::<Vec<_>>()[..] else { panic!("{line}") };
        let mut command = std::process::Command::new(path(program));
        let output = command.args(words).current_dir(sample.folder()).stdout(writer).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(!stderr.contains("error") && !stderr.contains("panicked"), "{line}: {stderr}");
        if !line.ends_with("--help") {
            assert_eq!(output.status.code(), Some(1), "{line}: {stderr}");
        }
    }
}
