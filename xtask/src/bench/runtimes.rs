//! `cargo xtask bench runtimes`: our encoder on one core next to ONNX Runtime and tract, same network, in turns.

use serde_json::Value;

use crate::error::Result;
use crate::json::{number, text};
use crate::program::Program;
use crate::python::environment;
use crate::workspace::Workspace;

/// Turns; the medians count.
const TURNS: usize = 3;

/// Seconds of each measurement.
const SECONDS: f64 = 2.0;

/// What is compared.
const FIGURES: [(&str, &str); 2] =
    [("one_image_ms", "one image, ms"), ("images_per_second", "batches of 64, images/s")];

/// The others, as the script names them.
const OTHERS: [&str; 2] = ["onnxruntime", "tract"];

/// Measures all three in turns on one core; the script refuses other embeddings than numpy's.
pub fn runtimes(workspace: &Workspace) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("bench-runtimes"))?;
    let python = environment(&out, "onnxruntime onnx tract numpy>=1.24 safetensors==0.8.0")?;
    let script = workspace.root.join("xtask").join("python").join("runtimes.py");
    let theirs = Program::new(python).arg(script).arg(workspace.shipped_model()).words(format!("{SECONDS}"));
    let ours = workspace.program("tactile-infer").words("speed --model").arg(workspace.shipped_model());
    let ours = ours.words(format!("--seconds {SECONDS} --json")).variable("RAYON_NUM_THREADS", "1");
    let mut turns: Vec<[Value; 2]> = Vec::new();
    for turn in 0..TURNS {
        let both = [ours.json(&out)?, theirs.json(&out)?];
        eprintln!("turn {}: ours {}, others {}", turn + 1, both[0], both[1]);
        turns.push(both);
    }
    let versions = OTHERS.map(|name| text(&turns[0][1], &format!("/{name}/version")));
    let [first, second] = versions;
    println!(
        "{:26} {:>9} {:>21} {:>13}",
        "on one core",
        "ours",
        format!("ONNX Runtime {}", first?),
        format!("tract {}", second?)
    );
    for (key, name) in FIGURES {
        let mut of_turns = [Vec::new(), Vec::new(), Vec::new()];
        for [ours, theirs] in &turns {
            of_turns[0].push(number(ours, &format!("/{key}"))?);
            for (values, other) in of_turns[1..].iter_mut().zip(OTHERS) {
                values.push(number(theirs, &format!("/{other}/{key}"))?);
            }
        }
        let [ours, first, second] = of_turns.map(|mut values| {
            values.sort_unstable_by(f64::total_cmp);
            values[values.len() / 2]
        });
        println!("{name:26} {ours:9.2} {first:21.2} {second:13.2}");
    }
    Ok(())
}
