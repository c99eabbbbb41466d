//! The Python wheel: built by maturin, installed as a user installs it, and tried.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::program::Program;
use crate::python::environment;
use crate::workspace::{Workspace, remove};

/// What `cargo xtask wheel` takes.
#[derive(Args)]
pub struct WheelArgs {
    /// Build the wheel into this folder and check nothing.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// What builds the wheel, and what its types are checked with.
const TOOLS: &str = "maturin>=1.9.4,<2";
const CHECKERS: &str = "mypy>=1.18 typing_extensions>=4.12";

/// Builds the wheel, installs it into a fresh virtual environment and runs what `filter/python/tests` has. Needs Python 3
/// and PyPI.
pub fn wheel(workspace: &Workspace, args: &WheelArgs) -> Result<()> {
    let scratch = workspace.folder(None, &workspace.target.join("wheel"))?;
    let out = workspace.folder(args.out.as_deref(), &scratch.join("dist"))?;
    let package = workspace.root.join("filter/python");
    let wheel = build(workspace, &scratch, &out, &package)?;
    let bytes = std::fs::metadata(&wheel).map_err(Error::io(&wheel))?.len();
    println!("wheel: {} of {:.2} MB", wheel.display(), bytes as f64 / 1e6);
    if args.out.is_some() {
        return Ok(());
    }

    let python = install(workspace, &scratch, &wheel)?;
    let fixture = workspace.folder(None, &scratch.join("fixture"))?;
    let write = Program::new(crate::workspace::cargo().path());
    write.words("run --release -p tactile-py --example fixture --").arg(&fixture).run(&workspace.root)?;
    // Not in the package's folder: the module must be found where it is installed.
    let run = |program: Program| program.run(&scratch).map(|_| ());
    let script = |name: &str| Program::new(&python).arg(package.join(name));
    run(script("tests/bits.py").arg(&fixture))?;
    run(script("tests/hostile.py").arg(&fixture))?;
    run(script("tests/load.py").arg(&fixture))?;
    run(script("examples/episode.py"))?;
    let mypy = Program::new(&python).words("-m mypy --strict --no-incremental");
    run(mypy.arg(package.join("examples/episode.py")))?;
    run(Program::new(&python).words("-m mypy.stubtest tactile_filter"))
}

/// Builds the wheel with maturin, from a virtual environment of its own; it is kept.
fn build(workspace: &Workspace, scratch: &Path, out: &Path, package: &Path) -> Result<PathBuf> {
    let tools = workspace.folder(None, &scratch.join("tools"))?;
    let python = environment(&tools, TOOLS)?;
    // Its name has the version and the platform: an older one would be a second.
    for old in wheels(out)? {
        remove(&old)?;
    }
    let maturin = Program::new(&python).words("-m maturin build --release --locked --interpreter").arg(&python);
    maturin.words("--out").arg(out).run(package)?;
    match wheels(out)?.as_slice() {
        [wheel] => Ok(wheel.clone()),
        found => Err(Error::invalid(out.display().to_string(), "one wheel", format!("{} wheels", found.len()))),
    }
}

/// Installs the wheel with what it needs into a fresh virtual environment; returns its Python.
fn install(workspace: &Workspace, scratch: &Path, wheel: &Path) -> Result<PathBuf> {
    let fresh = scratch.join("fresh");
    remove(&fresh)?;
    workspace.folder(None, &fresh)?;
    let python = environment(&fresh, CHECKERS)?;
    let pip = Program::new(&python).words("-m pip install --quiet --disable-pip-version-check");
    pip.arg(wheel).run(&fresh)?;
    let import = "import time; start = time.perf_counter(); import numpy; between = time.perf_counter(); \
                  import tactile_filter; end = time.perf_counter(); \
                  print(f'import: numpy {1e3 * (between - start):.1f} ms, then tactile_filter \
                  {tactile_filter.__version__} {1e3 * (end - between):.1f} ms')";
    Program::new(&python).words("-c").arg(import).run(scratch)?;
    Ok(python)
}

/// The wheels in a folder.
fn wheels(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder))?;
    let paths = entries.map(|entry| Ok(entry.map_err(Error::io(folder))?.path()));
    let paths = paths.collect::<Result<Vec<_>>>()?;
    Ok(paths.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "whl")).collect())
}
