//! The workspace as cargo and git see it: its folders, packages, programs and files.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::error::{Error, Result};
use crate::program;

/// Where things are, and what is there.
pub struct Workspace {
    /// The folder of the root manifest.
    pub root: PathBuf,
    /// Where cargo builds, `CARGO_TARGET_DIR` respected.
    pub target: PathBuf,
    /// Names of its packages.
    pub packages: Vec<String>,
    /// Names of its programs.
    pub programs: Vec<String>,
}

impl Workspace {
    /// Asks cargo.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize();
        let root = root.map_err(Error::io(env!("CARGO_MANIFEST_DIR")))?;
        let text = program::output(&cargo(), &["metadata", "--no-deps", "--format-version", "1"], &root)?;
        let metadata: Value =
            serde_json::from_str(&text).map_err(|error| Error::invalid("cargo metadata", "JSON", error.to_string()))?;
        let target = metadata["target_directory"].as_str().unwrap_or_default().into();
        let packages = array(&metadata["packages"]);
        let programs = packages
            .iter()
            .flat_map(|package| array(&package["targets"]))
            .filter(|target| array(&target["kind"]).iter().any(|kind| kind == "bin"));
        Ok(Self { root, target, programs: names(programs), packages: names(packages.iter()) })
    }

    /// Builds every program of the workspace but this one.
    pub fn build(&self) -> Result<()> {
        let args = ["build", "--release", "--workspace", "--exclude", "xtask"].map(OsStr::new);
        program::run("cargo build", Path::new(&cargo()), &args, &self.root).map(|_| ())
    }

    /// Builds the programs of one package.
    pub fn build_package(&self, package: &str) -> Result<()> {
        let args = ["build", "--release", "--package", package].map(OsStr::new);
        program::run("cargo build", Path::new(&cargo()), &args, &self.root).map(|_| ())
    }

    /// Path of a built program.
    pub fn program(&self, name: &str) -> PathBuf {
        self.target.join("release").join(name).with_extension(std::env::consts::EXE_EXTENSION)
    }

    /// Paths, relative to the root with `/` between, of the files that git tracks or would add.
    pub fn files(&self) -> Result<Vec<String>> {
        let args = ["ls-files", "-z", "--cached", "--others", "--exclude-standard", "--deduplicate"];
        let list = program::output(OsStr::new("git"), &args, &self.root)?;
        // A file deleted but not yet committed is still listed.
        Ok(list.split_terminator('\0').filter(|path| self.root.join(path).is_file()).map(String::from).collect())
    }
}

/// The cargo that runs this program, or the one on the path.
pub fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

fn array(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn names<'a>(values: impl Iterator<Item = &'a Value>) -> Vec<String> {
    values.filter_map(|value| value["name"].as_str()).map(String::from).collect()
}
