//! Rules for source files.

use super::Finding;

/// Written so that this file does not contain what it looks for.
const MACHINE_PATHS: [&str; 5] = [
    concat!("/", "home/"),
    concat!("/", "root/"),
    concat!("/", "work/"),
    concat!("/", "Users/"),
    concat!("/", "tmp/bash"),
];

/// How the tensor backends are named, and how a test is left out.
const WORDS: [&str; 7] =
    ["#[ignore", "Device::flex", "Device::ndarray", "Device::wgpu", "Device::cuda", "burn::backend", "burn_flex"];

/// The files that name a backend: where one is chosen, and where our own kernels join one; and the list of words.
const MAY_NAME: [&str; 5] = [
    "infer/src/embedding/device.rs",
    "infer/src/embedding/conv/op.rs",
    "train/src/card_frames/mod.rs",
    "train/src/lamb/mod.rs",
    "xtask/src/tidy/sources.rs",
];

/// Lines of code, comments left out, with a word that only some files may use.
pub fn words(path: &str, text: &str) -> Vec<Finding> {
    let code = text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"));
    let hit = |line: &str| WORDS.into_iter().find(|word| line.contains(word));
    let found = code.filter(|_| !MAY_NAME.contains(&path)).filter_map(|(n, line)| Some((n, hit(line)?)));
    found.map(|(n, word)| Finding::new(path, n + 1, format!("{word} has no place here"))).collect()
}

/// Absolute paths of somebody's machine, in any text file.
pub fn machine_paths(path: &str, text: &str) -> Vec<Finding> {
    // Behind a letter, a digit or a dot it is part of a longer path or of an address.
    let is_separate = |before: &str| !before.ends_with(|c: char| c.is_alphanumeric() || "._-~}/".contains(c));
    let hit = |line: &str| {
        MACHINE_PATHS.into_iter().find(|path| line.match_indices(path).any(|(at, _)| is_separate(&line[..at])))
    };
    let lines = text.lines().enumerate();
    lines
        .filter_map(|(n, line)| hit(line).map(|found| Finding::new(path, n + 1, format!("machine path {found}"))))
        .collect()
}

/// How no doc comment begins: with a genitive or a pronoun in place of the noun that it is about.
const NOUNLESS: [&str; 3] = ["Of ", "That of ", "Those "];

/// Words that a doc comment does without: a plainer one says the same to a reader whose first language is another.
const ARCHAIC: [&str; 4] = ["stands", "told", "lies", "beside"];

/// The folders whose doc comments do without them.
const PLAIN: [&str; 4] = ["data/src/", "infer/src/", "train/src/", "filter/src/"];

/// Doc comments that begin without their noun, and archaic words in them. A later line may begin with any word.
pub fn nounless(path: &str, text: &str) -> Vec<Finding> {
    let is_plain = PLAIN.iter().any(|folder| path.starts_with(folder));
    let (mut found, mut is_first) = (Vec::new(), true);
    for (n, line) in text.lines().enumerate() {
        let line = line.trim_start();
        let words = line.strip_prefix("/// ").or_else(|| line.strip_prefix("//! "));
        let begins =
            words.filter(|_| is_first).and_then(|words| NOUNLESS.into_iter().find(|word| words.starts_with(word)));
        if let Some(word) = begins {
            let what = format!("a doc comment begins with {:?}: name what it is about", word.trim_end());
            found.push(Finding::new(path, n + 1, what));
        }
        let each = words.filter(|_| is_plain).unwrap_or_default().split(|c: char| !c.is_alphanumeric());
        if let Some(word) = each.into_iter().find(|word| ARCHAIC.contains(&word.to_lowercase().as_str())) {
            found.push(Finding::new(path, n + 1, format!("a doc comment says {word:?}: say it in a plain word")));
        }
        is_first = words.is_none();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_files_name_a_backend_and_no_test_is_ignored() {
        let text = "/// Device::flex\nfn f() -> Device { Device::flex() }\n#[ignore = \"slow\"]\n";
        let found: Vec<_> = words("train/src/a.rs", text).iter().map(ToString::to_string).collect();
        let expected =
            ["train/src/a.rs:2: Device::flex has no place here", "train/src/a.rs:3: #[ignore has no place here"];
        assert_eq!(found, expected);
        assert!(MAY_NAME.iter().all(|path| words(path, text).is_empty()));
    }

    #[test]
    fn a_path_of_one_machine_is_separated_from_a_part_of_another_path() {
        for path in MACHINE_PATHS {
            assert_eq!(machine_paths("a.md", &format!("x\nsee {path}me")).len(), 1, "{path}");
            for before in ["https://example.org", "$HOME", "..", "network"] {
                assert!(machine_paths("a.md", &format!("{before}{path}me")).is_empty(), "{before}{path}");
            }
        }
    }

    #[test]
    fn a_doc_comment_names_what_it_is_about() {
        let text = "/// Of a row.\nfn a() {}\n    /// Those that count,\n    /// of which: x.\n\n    //! That of it.\n// Of code.\n\
                    /// The touches, and among them\n/// Those beyond.\n/// Office.\n";
        let found: Vec<_> = nounless("a.rs", text).iter().map(|finding| finding.line).collect();
        assert_eq!(found, [1, 3, 6]);
    }

    #[test]
    fn a_doc_comment_does_without_archaic_words() {
        let text = "/// The part beside it.\n//! A pose that\n//! Lies there, as it was told.\n// It stands.\nfn lies() {}\n\
                    /// A bystander besides.\n";
        let lines = |path: &str| nounless(path, text).iter().map(|finding| finding.line).collect::<Vec<_>>();
        assert!(PLAIN.iter().all(|folder| lines(&format!("{folder}a.rs")) == [1, 3]));
        assert!(lines("xtask/src/a.rs").is_empty());
    }
}
