//! The library, its headers, and what CMake and pkg-config look for, below a folder.

use std::fs;
use std::path::Path;

use super::{Library, source};
use crate::error::{Error, Result};
use crate::workspace::Workspace;

/// Files of the package and where they go.
const COPIED: [(&str, &str); 4] = [
    ("include/tactile_filter.h", "include/tactile_filter.h"),
    ("include/tactile_filter.hpp", "include/tactile_filter.hpp"),
    ("../../LICENSE-APACHE", "share/licenses/tactile_filter/LICENSE-APACHE"),
    ("../../LICENSE-MIT", "share/licenses/tactile_filter/LICENSE-MIT"),
];

/// The same, with versions to be filled in.
const FILLED_IN: [(&str, &str); 3] = [
    ("cmake/TactileFilterConfig.cmake.in", "lib/cmake/TactileFilter/TactileFilterConfig.cmake"),
    ("cmake/TactileFilterConfigVersion.cmake.in", "lib/cmake/TactileFilter/TactileFilterConfigVersion.cmake"),
    ("cmake/tactile_filter.pc.in", "lib/pkgconfig/tactile_filter.pc"),
];

/// Writes everything below `prefix`, which may be moved afterwards.
pub fn install(workspace: &Workspace, library: &Library, prefix: &Path) -> Result<()> {
    let read = |path: &Path| fs::read(path).map_err(Error::io(path));
    for (from, to) in COPIED {
        put(&prefix.join(to), &read(&source(workspace, from))?)?;
    }
    for (from, to) in FILLED_IN {
        let path = source(workspace, from);
        let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
        let filled = text.replace("@VERSION@", env!("CARGO_PKG_VERSION")).replace("@ABI@", &library.abi.to_string());
        put(&prefix.join(to), filled.as_bytes())?;
    }
    let shared = format!("lib/libtactile_filter.so.{}", library.abi);
    put(&prefix.join("lib/libtactile_filter.a"), &read(&library.archive)?)?;
    put(&prefix.join(&shared), &read(&library.shared)?)?;
    link(&prefix.join(shared), &prefix.join("lib/libtactile_filter.so"))
}

/// Writes a file next to its place and moves it there: a program that has the old library loaded keeps it.
fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(".tmp");
    fs::write(&temporary, bytes).map_err(Error::io(&temporary))?;
    fs::rename(&temporary, path).map_err(Error::io(path))
}

/// A link by name within one folder, so that the folder can be moved.
#[cfg(unix)]
fn link(to: &Path, path: &Path) -> Result<()> {
    crate::workspace::remove(path)?;
    std::os::unix::fs::symlink(to.file_name().unwrap_or_default(), path).map_err(Error::io(path))
}

#[cfg(not(unix))]
fn link(to: &Path, path: &Path) -> Result<()> {
    fs::copy(to, path).map(|_| ()).map_err(Error::io(path))
}
