//! Text that comes from files and names, made safe to print: a terminal obeys control characters.

use std::borrow::Cow;

/// The text with each character that a terminal would obey instead of show written as an escape, `\u{1b}` or `\n`:
/// control characters, and characters that turn the direction of text or end a line.
///
/// What a file or a name says goes through it before it is printed. An error that quotes a file stays one line.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, is_obeyed)
}

/// [`printable`] of a text of several lines, whose line ends stay.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |letter| letter != '\n' && is_obeyed(letter))
}

/// [`printable`] of JSON, which says the same with the escapes of JSON. Line ends between values stay.
pub fn printable_json(json: &str) -> Cow<'_, str> {
    let is_escaped = |letter: char| letter != '\n' && is_obeyed(letter);
    // None of them is beyond four digits.
    escaped_as(json, is_escaped, |letter| format!("\\u{:04x}", u32::from(letter)))
}

/// Whether a text is fit for a name: no character of it would be obeyed by a terminal.
pub fn is_printable(text: &str) -> bool {
    !text.contains(is_obeyed)
}

/// Controls (C0, DEL, C1); line and paragraph separators; marks that turn the direction of what follows.
fn is_obeyed(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    escaped_as(text, is_escaped, |letter| letter.escape_default().to_string())
}

fn escaped_as(text: &str, is_escaped: impl Fn(char) -> bool, escape: fn(char) -> String) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let letter = |letter: char| if is_escaped(letter) { escape(letter) } else { letter.into() };
    Cow::Owned(text.chars().map(letter).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_obeys_is_shown_and_all_else_stays() {
        for (text, shown) in [
            ("A, \u{e9}\u{4e2d}\u{1f600} \\ 'x'", "A, \u{e9}\u{4e2d}\u{1f600} \\ 'x'"),
            ("a\u{1b}[2Jb", "a\\u{1b}[2Jb"),
            ("bell\u{7} back\u{8} del\u{7f} csi\u{9b}", "bell\\u{7} back\\u{8} del\\u{7f} csi\\u{9b}"),
            ("two\nlines\r\tthere", "two\\nlines\\r\\tthere"),
            ("turned \u{202e}round\u{2069}\u{2028}", "turned \\u{202e}round\\u{2069}\\u{2028}"),
        ] {
            assert_eq!(printable(text), shown);
            assert_eq!(is_printable(text), text == shown);
        }
        assert!(matches!(printable("as it is"), Cow::Borrowed("as it is")));
        assert_eq!(printable_lines("one\ntwo\u{1b}c"), "one\ntwo\\u{1b}c");
    }

    #[test]
    #[cfg(feature = "datasets")]
    fn json_says_the_same_in_escapes() {
        let names = ["csi\u{9b}2J", "\u{202e}", "A"];
        let json = serde_json::to_string_pretty(&names).unwrap();
        let shown = printable_json(&json);
        assert!(is_printable(&shown.replace('\n', "")) && shown.lines().count() == 5, "{shown}");
        assert_eq!(serde_json::from_str::<[String; 3]>(&shown).unwrap(), names);
    }
}
