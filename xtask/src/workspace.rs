//! The workspace as cargo and git see it: its folders, packages, programs and files.

use std::fs;
use std::path::{Path, PathBuf, absolute};

use serde_json::Value;

use crate::error::{Error, Result};
use crate::json;
use crate::program::{Program, Usage};

/// Where things are.
pub struct Workspace {
    /// The folder of the root manifest.
    pub root: PathBuf,
    /// Where cargo builds, `CARGO_TARGET_DIR` respected.
    pub target: PathBuf,
}

impl Workspace {
    /// Asks cargo.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize();
        let root = root.map_err(Error::io(env!("CARGO_MANIFEST_DIR")))?;
        let target = metadata(&root)?["target_directory"].as_str().unwrap_or_default().into();
        Ok(Self { root, target })
    }

    /// The packages as `cargo metadata` describes them.
    pub fn packages(&self) -> Result<Vec<Value>> {
        json::entries(&metadata(&self.root)?, "/packages").map(<[Value]>::to_vec)
    }

    /// Builds every program of the workspace but this one.
    pub fn build(&self) -> Result<()> {
        self.cargo("build --release --workspace --exclude xtask").map(|_| ())
    }

    /// Builds one program.
    pub fn build_program(&self, name: &str) -> Result<()> {
        self.cargo(&format!("build --release --bin {name}")).map(|_| ())
    }

    /// Runs cargo in the workspace.
    pub fn cargo(&self, words: &str) -> Result<Usage> {
        cargo().words(words).run(&self.root)
    }

    /// A built program.
    pub fn program(&self, name: &str) -> Program {
        Program::new(self.programs().join(name).with_extension(std::env::consts::EXE_EXTENSION))
    }

    /// The folder of the built programs.
    pub fn programs(&self) -> PathBuf {
        self.target.join("release")
    }

    /// The checkpoint that comes with the project.
    pub fn shipped_model(&self) -> PathBuf {
        ["infer", "models", "maze-small.safetensors"].iter().fold(self.root.clone(), |path, name| path.join(name))
    }

    /// Absolute path of the folder that a user chose, or of one in the workspace; it is made.
    pub fn folder(&self, chosen: Option<&Path>, default: &Path) -> Result<PathBuf> {
        let folder = match chosen {
            Some(folder) => absolute(folder).map_err(Error::io(folder))?,
            None => self.root.join(default),
        };
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        Ok(folder)
    }

    /// Paths, relative to the root with `/` between, of the files that git tracks or would add.
    pub fn files(&self) -> Result<Vec<String>> {
        let git = Program::new("git").words("ls-files -z --cached --others --exclude-standard --deduplicate");
        let list = git.output(&self.root)?;
        // A file deleted but not yet committed is still listed.
        Ok(list.split_terminator('\0').filter(|path| self.root.join(path).is_file()).map(String::from).collect())
    }
}

/// The cargo that runs this program, or the one on the search path.
pub fn cargo() -> Program {
    Program::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// Removes a file, or a folder with all that is in it, where there is one.
pub fn remove(path: &Path) -> Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(_) => Ok(()),
    };
    removed.map_err(Error::io(path))
}

fn metadata(root: &Path) -> Result<Value> {
    cargo().words("metadata --no-deps --format-version 1").json(root)
}
