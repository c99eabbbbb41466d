//! Which code made a result: the commit of the workspace, and whether tracked files differed from it.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::program::Program;

/// The code that made something.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Code {
    /// A commit.
    Commit {
        /// Its 40 hexadecimal digits.
        commit: String,
        /// Whether tracked files differed from it.
        dirty: bool,
    },
    /// No commit can be named.
    Unknown {
        /// The reason.
        unknown: String,
    },
}

impl Code {
    /// The code of the workspace in `root`, as git knows it. Without git, or without a repository of its own, it is
    /// unknown: no error, because results can be made of an archive as well.
    pub fn of(root: &Path) -> Self {
        let ask = || {
            let prefix = git(root, "rev-parse --show-prefix")?;
            if !prefix.is_empty() {
                return Err("the workspace is not the top of its repository".into());
            }
            let commit = git(root, "rev-parse --verify HEAD")?;
            let changed = git(root, "status --porcelain --untracked-files=no")?;
            Ok(Self::Commit { commit, dirty: !changed.is_empty() })
        };
        ask().unwrap_or_else(|reason: String| Self::unknown(&format!("git: {reason}")))
    }

    /// No commit, for a reason.
    pub fn unknown(reason: &str) -> Self {
        Self::Unknown { unknown: reason.into() }
    }

    /// The code of something that two made: the same, or unknown for a reason.
    pub fn and(self, other: Self, reason: &str) -> Self {
        if self == other { self } else { Self::unknown(reason) }
    }

    /// The code that the note of a step says.
    pub fn read(note: &Value) -> Self {
        Self::deserialize(&note["code"]).unwrap_or_else(|_| Self::unknown("no code is noted"))
    }

    /// Adds the code to a note, which is an object.
    pub fn write(&self, note: &mut Value) {
        note["code"] = json!(self);
    }
}

/// What git says of a folder; its first complaint where it fails.
pub fn git(root: &Path, words: &str) -> std::result::Result<String, String> {
    let output = Program::new("git").words(words).command(root).output().map_err(|error| error.to_string())?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim_end().to_owned();
    if output.status.success() {
        return Ok(text(&output.stdout));
    }
    Err(text(&output.stderr).lines().next().unwrap_or("no reason").into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::remove;
    use std::fs;

    #[test]
    fn a_commit_is_named_with_what_differs_from_it_and_no_repository_is_no_commit() {
        let folder = std::env::temp_dir().join(format!("xtask-code-{}", std::process::id()));
        remove(&folder).unwrap();
        fs::create_dir_all(folder.join("inside")).unwrap();
        let git = |words: &str| {
            Program::new("git").words("-c user.name=a -c user.email=a@b").words(words).output(&folder).unwrap()
        };
        assert!(matches!(Code::of(&folder), Code::Unknown { unknown } if unknown.starts_with("git: ")));
        git("init --quiet");
        assert!(matches!(Code::of(&folder), Code::Unknown { .. }), "no commit yet");
        fs::write(folder.join("file"), "1").unwrap();
        git("add file");
        git("commit --quiet --message first");
        let commit = git("log -1 --format=%H").trim().to_owned();
        let of = |dirty| Code::Commit { commit: commit.clone(), dirty };
        fs::write(folder.join("result"), "untracked").unwrap();
        assert_eq!(Code::of(&folder), of(false));
        fs::write(folder.join("file"), "2").unwrap();
        assert_eq!(Code::of(&folder), of(true));
        assert_eq!(
            Code::of(&folder.join("inside")),
            Code::unknown("git: the workspace is not the top of its repository")
        );
        remove(&folder).unwrap();
    }

    #[test]
    fn what_a_note_says_is_read_again_and_a_note_without_code_is_unknown() {
        for code in [Code::Commit { commit: "a".repeat(40), dirty: true }, Code::unknown("git: none")] {
            let mut note = json!({});
            code.write(&mut note);
            assert_eq!(Code::read(&note), code);
        }
        assert!(matches!(Code::read(&json!({ "command": "c" })), Code::Unknown { .. }));
    }
}
