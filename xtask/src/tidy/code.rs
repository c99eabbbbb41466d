//! Rust source with all that is not code blanked out, so that a search finds code only.

/// Blanks comments, strings and character literals; every newline stays where it was.
pub fn code_only(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut code = String::with_capacity(text.len());
    let mut at = 0;
    while at < chars.len() {
        let end = match chars[at] {
            '/' if chars.get(at + 1) == Some(&'/') => line_end(&chars, at),
            '/' if chars.get(at + 1) == Some(&'*') => comment_end(&chars, at),
            '"' => string_end(&chars, at),
            '\'' => character_end(&chars, at),
            _ => at,
        };
        if end == at {
            code.push(chars[at]);
            at += 1;
        } else {
            code.extend(chars[at..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
            at = end;
        }
    }
    code
}

/// Blanks every item behind `#[cfg(test)]` in text that [`code_only`] made.
pub fn without_tests(code: &str) -> String {
    let mut library = String::with_capacity(code.len());
    let mut rest = code;
    while let Some(start) = rest.find("#[cfg(test)]") {
        let item = &rest[start..];
        let end = item_end(item);
        library.push_str(&rest[..start]);
        library.extend(item[..end].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        rest = &item[end..];
    }
    library + rest
}

/// Where the first item ends: behind its semicolon or its closing brace.
fn item_end(item: &str) -> usize {
    let mut depth = 0_usize;
    for (at, c) in item.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && (c == '}' || c == ';') {
            return at + 1;
        }
    }
    item.len()
}

fn line_end(chars: &[char], at: usize) -> usize {
    chars[at..].iter().position(|&c| c == '\n').map_or(chars.len(), |length| at + length)
}

/// Block comments nest.
fn comment_end(chars: &[char], start: usize) -> usize {
    let (mut depth, mut at) = (0, start);
    while at < chars.len() {
        match (chars[at], chars.get(at + 1)) {
            ('/', Some('*')) => (depth, at) = (depth + 1, at + 2),
            ('*', Some('/')) if depth == 1 => return at + 2,
            ('*', Some('/')) => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    chars.len()
}

/// A string is raw where an `r` and any hashes stand before its quote.
fn string_end(chars: &[char], quote: usize) -> usize {
    let n_hashes = chars[..quote].iter().rev().take_while(|&&c| c == '#').count();
    let raw = chars[..quote - n_hashes].last() == Some(&'r');
    let mut at = quote + 1;
    while at < chars.len() {
        match chars[at] {
            '\\' if !raw => at += 1,
            '"' if !raw => return at + 1,
            '"' if chars[at + 1..].iter().take(n_hashes).filter(|&&c| c == '#').count() == n_hashes => {
                return at + 1 + n_hashes;
            }
            _ => {}
        }
        at += 1;
    }
    chars.len()
}

/// A quote begins a character where the next but one is a quote too or an escape follows; else it is a
/// lifetime.
fn character_end(chars: &[char], quote: usize) -> usize {
    match (chars.get(quote + 1), chars.get(quote + 2)) {
        (Some('\\'), Some(_)) => {
            let close = chars[quote + 3..].iter().position(|&c| c == '\'');
            close.map_or(chars.len(), |length| quote + 3 + length + 1)
        }
        (Some(_), Some('\'')) => quote + 3,
        _ => quote,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        code_only(text).split_whitespace().map(String::from).collect()
    }

    #[test]
    fn only_code_is_left() {
        assert_eq!(words("a // b\nc /* d /* e */ f */ g"), ["a", "c", "g"]);
        assert_eq!(words(r#"a "b \" c" d"#), ["a", "d"]);
        assert_eq!(words("r#\"b \" c\"# d r\"\\\" e"), ["r#", "d", "r", "e"]);
    }

    #[test]
    fn a_lifetime_is_code_and_a_character_is_not() {
        assert_eq!(words("&'a str '\"' x '\\'' y '\\u{1F}' 'z'"), ["&'a", "str", "x", "y"]);
    }

    #[test]
    fn lines_stay_where_they_are() {
        let text = "/* 1\n2 */\n\"3\n4\"\nfive\n";
        assert_eq!(code_only(text).lines().position(|line| line.contains("five")), Some(4));
        let code = "a\n#[cfg(test)]\nmod tests {\n  fn f() { g() }\n}\nb\n";
        let library = without_tests(code);
        assert_eq!(library.split_whitespace().collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(library.lines().count(), code.lines().count());
    }

    #[test]
    fn a_test_item_may_have_no_braces() {
        assert_eq!(without_tests("#[cfg(test)] use a::b; d").trim(), "d");
        assert_eq!(without_tests("#[cfg(test)] fn f(x: [u8; 3]) { g(); } d").trim(), "d");
    }
}
