//! Texts in the cells of a CSV file, which spreadsheets run as formulas where they begin like one.

/// What a cell begins with that a spreadsheet runs, and the apostrophe that stops it.
const RUN: [char; 7] = ['=', '+', '-', '@', '\t', '\r', '\''];

/// A text as a cell: behind an apostrophe where a spreadsheet would run it. [`text_of`] gives the text back. Numbers need none.
pub fn cell_of(text: String) -> String {
    if text.starts_with(RUN) { format!("'{text}") } else { text }
}

/// The text of a cell: without the apostrophe in front of what a spreadsheet would run.
pub fn text_of(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| text.starts_with(RUN)).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cell_is_run_and_each_gives_its_text_back() {
        for text in
            ["=1+1", "+A1", "-2", "@SUM(A1)", "\tx", "\rx", "'", "''", "'=1", "'A", "A", "", "a=b", "5-pin", "O'Neil"]
        {
            let cell = cell_of(text.to_owned());
            assert!(!cell.starts_with(['=', '+', '-', '@', '\t', '\r']), "{cell:?}");
            assert_eq!(text_of(&cell), text);
            assert_eq!(cell == text, !text.starts_with(RUN), "{cell:?}");
        }
        // What people write themselves stays.
        assert_eq!(["'tis", "'", "-2", "=1"].map(text_of), ["'tis", "'", "-2", "=1"]);
    }
}
