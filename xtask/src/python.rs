//! The weights read from outside: numpy's forward pass against `tactile-infer`'s.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::Workspace;

/// What `cargo xtask python` takes.
#[derive(Args)]
pub struct PythonArgs {
    /// The model whose forward pass is computed twice [default: the shipped one].
    #[arg(long)]
    model: Option<PathBuf>,
}

/// What the script imports.
const REQUIREMENTS: [&str; 2] = ["numpy>=1.24", "safetensors==0.8.0"];

/// Presses of letters' holes: shape and pose.
const TOUCHES: [(&str, &str); 4] =
    [("letter:A:12", "1,0,30"), ("letter:B:12", "-2,3,75"), ("letter:K:12", "4,1,-60"), ("letter:X:12", "0,0,0")];

/// Makes a virtual environment in the build folder, renders some touches, embeds them with `tactile-infer` and lets
/// `xtask/python/forward.py` do the same in numpy: for the model and for it with weights of f16. The first run needs
/// Python 3 and PyPI.
pub fn python(workspace: &Workspace, args: &PythonArgs) -> Result<()> {
    let out = workspace.target.join("python");
    let touches = out.join("touches");
    fs::create_dir_all(&touches).map_err(Error::io(&touches))?;
    let python = environment(&out, &REQUIREMENTS)?;
    workspace.build_package("tactile-data")?;
    workspace.build_package("tactile-infer")?;
    let [data, infer] = ["tactile-data", "tactile-infer"].map(|name| workspace.program(name));
    let run = |program: &Path, line: &[&str]| {
        let args: Vec<&OsStr> = line.iter().map(OsStr::new).collect();
        program::run(&program::command_line(program, &args), program, &args, &touches).map(|_| ())
    };

    let mut images = Vec::new();
    for (shape, pose) in TOUCHES {
        let (image, pose) = (format!("{}.png", shape.replace(':', "-")), format!("--pose={pose}"));
        let files = ["--out", &image, "--at-rest-out", "rest.png"];
        run(&data, &[&["render", shape, &pose, "--as-hole", "--frame-px", "160x120"], &files[..]].concat())?;
        images.push(image);
    }
    let model = args.model.clone().unwrap_or_else(|| workspace.root.join("infer/models/maze-small.safetensors"));
    let model = word(&model.canonicalize().map_err(Error::io(&model))?)?;
    let script = word(&workspace.root.join("xtask/python/forward.py"))?;
    run(&infer, &["convert", "--model", &model, "--weights", "f16", "--out", "f16.safetensors"])?;
    for model in [model.as_str(), "f16.safetensors"] {
        for side in ["hole", "peg"] {
            let embed = ["embed", "--json", "--side", side, "--model", model, "--no-contact", "rest.png"];
            let mut line = [&embed[..], &["--dump-input", "input.npy"]].concat();
            line.extend(images.iter().map(String::as_str));
            let json = touches.join(format!("{side}.json"));
            fs::write(&json, program::output(infer.as_os_str(), &line, &touches)?).map_err(Error::io(&json))?;
        }
        println!("{model}:");
        run(&python, &[&script, model, "input.npy", "hole.json", "peg.json"])?;
    }
    Ok(())
}

/// A path as an argument.
fn word(path: &Path) -> Result<String> {
    let text = path.to_str().map(String::from);
    text.ok_or_else(|| Error::invalid(path.display().to_string(), "a path in Unicode", "another"))
}

/// A virtual environment in `out` with what a script imports; made once. Returns its Python.
pub fn environment(out: &Path, requirements: &[&str]) -> Result<PathBuf> {
    let venv = out.join("venv");
    let python = if cfg!(windows) { venv.join("Scripts/python.exe") } else { venv.join("bin/python") };
    let made = venv.join("made");
    if made.exists() {
        return Ok(python);
    }
    let system = Path::new(if cfg!(windows) { "python" } else { "python3" });
    program::run("python3 -m venv", system, &["-m".as_ref(), "venv".as_ref(), venv.as_os_str()], out)?;
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    let install: Vec<&OsStr> = install.iter().chain(requirements).map(OsStr::new).collect();
    program::run("pip install", &python, &install, out)?;
    fs::write(&made, requirements.join("\n")).map_err(Error::io(&made))?;
    Ok(python)
}
