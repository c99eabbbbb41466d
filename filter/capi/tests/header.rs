//! The committed header is the one that cbindgen makes of the source.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::path::Path;

use cbindgen::{Builder, Config};

/// The sources in the header's order.
const SOURCES: [&str; 9] = ["status", "value", "model", "sensor", "light", "config", "episode", "insertion", "runner"];

#[test]
fn the_header_is_made_of_the_source() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = Config::from_file(folder.join("cbindgen.toml")).unwrap();
    // No file with a function of C's is left out.
    for file in std::fs::read_dir(folder.join("src")).unwrap().map(|file| file.unwrap().path()) {
        let name = file.file_stem().unwrap().to_str().unwrap();
        let is_of_c = std::fs::read_to_string(&file).unwrap().contains("extern \"C\" fn");
        assert!(!is_of_c || SOURCES.contains(&name), "{name}.rs is in no header");
    }
    let sources = SOURCES.iter().map(|name| folder.join(format!("src/{name}.rs")));
    let bindings = sources.fold(Builder::new().with_config(config), Builder::with_src).generate().unwrap();
    let mut made = Vec::new();
    bindings.write(&mut made);
    let made = String::from_utf8(made).unwrap();
    let path = folder.join("include/tactile_filter.h");
    if std::env::var_os("TACTILE_WRITE_HEADER").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default().replace("\r\n", "\n");
    let differs = made.lines().zip(committed.lines()).find(|(made, committed)| made != committed);
    assert!(
        made == committed,
        "expected {} as cbindgen makes it, got another from {differs:?} on; to make it anew:\n    \
         TACTILE_WRITE_HEADER=1 cargo test --release -p tactile-capi --test header",
        path.display()
    );
}
