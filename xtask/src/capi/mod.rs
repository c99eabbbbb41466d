//! The filter as a C library: built, installed, and held against compilers, valgrind, sanitizers and CMake.

mod check;
mod figures;
mod install;

use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::workspace::{Workspace, cargo};

/// What `cargo xtask capi` takes.
#[derive(Args)]
pub struct CapiArgs {
    /// Only builds the library, and installs it with headers, CMake and pkg-config files below this folder. Linux.
    #[arg(long, value_name = "PREFIX")]
    install: Option<PathBuf>,
}

/// Installs the library where asked; else checks it in every way that needs more than a Rust toolchain.
pub fn capi(workspace: &Workspace, args: &CapiArgs) -> Result<()> {
    match &args.install {
        Some(prefix) => {
            let prefix = workspace.folder(Some(prefix), Path::new("."))?;
            install::install(workspace, &Library::build(workspace)?, &prefix)?;
            println!("installed below {}", prefix.display());
            Ok(())
        }
        None => check::check(workspace),
    }
}

/// The built library.
pub struct Library {
    /// Shared, stripped.
    shared: PathBuf,
    /// Static.
    archive: PathBuf,
    /// The version of its interface, part of the shared library's name.
    abi: u32,
}

impl Library {
    /// Builds it with the name by which programs will look for it.
    fn build(workspace: &Workspace) -> Result<Self> {
        if !cfg!(target_os = "linux") {
            return Err(Error::invalid("cargo xtask capi", "Linux", std::env::consts::OS));
        }
        let abi = abi(workspace)?;
        let words = "rustc --release --package tactile-capi --lib -- -C strip=symbols -C link-arg=-Wl,-soname,";
        cargo().words(format!("{words}libtactile_filter.so.{abi}")).run(&workspace.root)?;
        let built = |name: &str| workspace.programs().join(name);
        Ok(Self { shared: built("libtactile_capi.so"), archive: built("libtactile_capi.a"), abi })
    }
}

/// A file or folder of the package.
fn source(workspace: &Workspace, path: &str) -> PathBuf {
    workspace.root.join("filter").join("capi").join(path)
}

/// The version of the interface, as the header says it.
fn abi(workspace: &Workspace) -> Result<u32> {
    let header = source(workspace, "include/tactile_filter.h");
    let text = std::fs::read_to_string(&header).map_err(Error::io(&header))?;
    let line = text.lines().find_map(|line| line.strip_prefix("#define TF_ABI_VERSION "));
    let number = line.and_then(|number| number.trim().parse().ok());
    number.ok_or_else(|| Error::invalid(header.display().to_string(), "#define TF_ABI_VERSION", "none"))
}
