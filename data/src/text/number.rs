//! Numbers in messages for people.

/// More digits than any whole number of 64 bits has.
const MANY: usize = 20;

/// A text in which each number of more than 20 digits has an exponent instead: `1e300` and not a one with 300 zeros.
/// Digits that are part of a name, of a path or of a checksum stay as they are.
pub fn short_numbers(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let length = rest[start..].find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.len() - start);
        // A full stop behind a number is not of it.
        let end = start + rest[start..start + length].trim_end_matches('.').len();
        let (before, digits, after) = (&rest[..start], &rest[start..end], &rest[end..]);
        let is_part_of_name = |c: char| c.is_alphanumeric() || matches!(c, '_' | '/' | '\\');
        let is_name = before.chars().next_back().is_some_and(is_part_of_name)
            || after.trim_start_matches('.').starts_with(is_part_of_name);
        short.push_str(before);
        let n_digits = digits.bytes().filter(u8::is_ascii_digit).count();
        match digits.parse::<f64>() {
            Ok(number) if n_digits > MANY && !is_name => short.push_str(&format!("{number:e}")),
            _ => short.push_str(digits),
        }
        rest = after;
    }
    short.push_str(rest);
    short
}

/// A number in a message, short whatever its size.
pub fn short(number: f64) -> String {
    short_numbers(&number.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_any_size_is_short_and_reads_back() {
        for number in [0.0, 1.0, -4.5, 0.1, 1e15, 1e16, 1e20, -1e300, f64::MAX, f64::MIN_POSITIVE, -5e-324, 1.5e-9] {
            let text = short(number);
            assert!(text.len() <= 26 && text.parse() == Ok(number), "{number:e}: {text}");
        }
        assert_eq!([short(1e300), short(-2.5e-30), short(2.0), short(0.05)], ["1e300", "-2.5e-30", "2", "0.05"]);
        assert_eq!([f64::NAN, f64::INFINITY].map(short), ["NaN", "inf"]);
    }

    #[test]
    fn numbers_within_a_text_are_short_and_names_stay() {
        let text = format!("x {} mm and {}, at 12.5", 1e300, -1e-300);
        assert_eq!(short_numbers(&text), "x 1e300 mm and -1e-300, at 12.5");
        // As serde has it.
        let serde = format!("invalid type: floating point `{}.0`, expected usize.", 1e300);
        assert_eq!(short_numbers(&serde), "invalid type: floating point `1e300`, expected usize.");
        assert_eq!(short_numbers(&format!("got {}.", 1e300)), "got 1e300.");
        let digits = "1".repeat(40);
        for name in [format!("{digits}.png"), format!("a/{digits}"), format!("ab{digits}"), format!("{digits}f0 x")] {
            assert_eq!(short_numbers(&name), name);
        }
        assert_eq!(short_numbers(&format!("{}, {}", u64::MAX, i64::MIN)), format!("{}, {}", u64::MAX, i64::MIN));
        assert_eq!(short_numbers("1.2.3 é 7"), "1.2.3 é 7");
    }
}
