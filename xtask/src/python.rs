//! The weights read from outside: numpy's forward pass against `tactile-infer`'s.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::program::Program;
use crate::workspace::{Workspace, remove};

/// What `cargo xtask python` takes.
#[derive(Args)]
pub struct PythonArgs {
    /// The model whose forward pass is computed twice [default: the shipped one].
    #[arg(long)]
    model: Option<PathBuf>,
}

/// What the script imports.
const REQUIREMENTS: &str = "numpy>=1.24 safetensors==0.8.0";

/// Presses of letters' holes: shape and pose.
const TOUCHES: [(&str, &str); 4] =
    [("letter:A:12", "1,0,30"), ("letter:B:12", "-2,3,75"), ("letter:K:12", "4,1,-60"), ("letter:X:12", "0,0,0")];

/// Makes a virtual environment in the build folder, renders some touches, embeds them with `tactile-infer` and lets
/// `xtask/python/forward.py` do the same in numpy: for the model and for it with weights of f16. The first run needs
/// Python 3 and PyPI.
pub fn python(workspace: &Workspace, args: &PythonArgs) -> Result<()> {
    let out = workspace.folder(None, &workspace.target.join("python"))?;
    let touches = workspace.folder(None, &out.join("touches"))?;
    let python = environment(&out, REQUIREMENTS)?;
    workspace.build_program("tactile-data")?;
    workspace.build_program("tactile-infer")?;
    let [data, infer] = ["tactile-data", "tactile-infer"].map(|name| workspace.program(name));

    let mut images = String::new();
    for (shape, pose) in TOUCHES {
        let image = format!("{}.png", shape.replace(':', "-"));
        let render = format!("render {shape} --pose={pose} --as-hole --frame-px 160x120");
        data.clone().words(render).words(format!("--out {image} --at-rest-out rest.png")).run(&touches)?;
        images += &format!(" {image}");
    }
    let model = args.model.clone().unwrap_or_else(|| workspace.shipped_model());
    let model = model.canonicalize().map_err(Error::io(&model))?;
    let convert = infer.clone().words("convert --model").arg(&model);
    convert.words("--weights f16 --out f16.safetensors").run(&touches)?;
    for model in [model.as_path(), Path::new("f16.safetensors")] {
        for side in ["hole", "peg"] {
            let embed = infer
                .clone()
                .words("embed --model")
                .arg(model)
                .words(format!("--json --side {side} --no-contact rest.png --dump-input input.npy{images}"));
            let json = touches.join(format!("{side}.json"));
            fs::write(&json, embed.output(&touches)?).map_err(Error::io(&json))?;
        }
        println!("{}:", model.display());
        let compare = Program::new(&python).arg(workspace.root.join("xtask/python/forward.py")).arg(model);
        compare.words("input.npy hole.json peg.json").run(&touches)?;
    }
    let python = bags(&out, &data)?;
    live_log(workspace, &out.join("live"), &python)
}

/// What the script of bags imports.
const BAG_REQUIREMENTS: &str = "numpy>=1.24 pillow rosbags==0.11.9 mcap-ros2-support==0.6.0";

/// ROS 2 bags between `tactile-data` and independent programs, both ways, byte for byte.
fn bags(out: &Path, data: &Program) -> Result<PathBuf> {
    let out = out.join("bags");
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    let python = environment(&out, BAG_REQUIREMENTS)?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/mcap_interop.py");
    Program::new(&python).arg(script).arg(data.path()).run(&out)?;
    Ok(python)
}

/// A live node's log, read by the same independent programs.
fn live_log(workspace: &Workspace, out: &Path, python: &Path) -> Result<()> {
    remove(out)?;
    fs::create_dir_all(out).map_err(Error::io(out))?;
    workspace.build_program("tactile-filter")?;
    let [infer, filter] = ["tactile-infer", "tactile-filter"].map(|name| workspace.program(name));
    let model = workspace.shipped_model();
    let bank = "--scene alphabet-small --xy-step-mm 2 --theta-step-deg 15 --out pegs.bank";
    infer.words("bank --model").arg(&model).words(bank).run(out)?;
    let live = filter.clone().words("live --model").arg(&model);
    live.words("--bank pegs.bank --simulate alphabet-small --fast --log live.mcap").run(out)?;
    let replay = filter.words("replay --model").arg(&model).words("--bank pegs.bank --log live.mcap --json");
    let decisions = out.join("decisions.jsonl");
    fs::write(&decisions, replay.output(out)?).map_err(Error::io(&decisions))?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/python/live_log.py");
    Program::new(python).arg(script).words("live.mcap decisions.jsonl").run(out)?;
    let venv = out.with_file_name("rerun");
    fs::create_dir_all(&venv).map_err(Error::io(&venv))?;
    let rerun = environment(&venv, RERUN)?.with_file_name("rerun").with_extension(std::env::consts::EXE_EXTENSION);
    Program::new(rerun).words("mcap check live.mcap").run(out).map(|_| ())
}

/// A viewer that checks MCAP files.
const RERUN: &str = "rerun-sdk==0.41.0";

/// A virtual environment in `out` with what a script imports; made once. Returns its Python.
pub fn environment(out: &Path, requirements: &str) -> Result<PathBuf> {
    let venv = out.join("venv");
    let python = if cfg!(windows) { venv.join("Scripts/python.exe") } else { venv.join("bin/python") };
    let made = venv.join("made");
    if made.exists() {
        return Ok(python);
    }
    let system = Program::new(if cfg!(windows) { "python" } else { "python3" });
    system.words("-m venv").arg(&venv).run(out).map_err(|error| match error {
        Error::Io { source, .. } if source.kind() == ErrorKind::NotFound => {
            Error::NotInstalled { what: "Python 3".into(), packages: "python3 python3-venv" }
        }
        other => other,
    })?;
    let pip = Program::new(&python).words("-m pip install --quiet --disable-pip-version-check");
    pip.words(requirements).run(out)?;
    fs::write(&made, requirements).map_err(Error::io(&made))?;
    Ok(python)
}
