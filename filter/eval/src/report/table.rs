//! Tables whose rows sort by a column when its head is pressed.

/// What sorts them, once in a page. A column sorts by the first text of its cells: numbers as numbers,
/// what is no number after them; pressed again, the other way round.
pub const SCRIPT: &str = r#"<script>
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => head.firstChild.addEventListener("click", () => {
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    heads.forEach(other => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const key = row => (row.cells[column].firstChild?.textContent ?? "").trim().replace("−", "-");
    const compare = (a, b) => {
      const [x, y] = [parseFloat(a), parseFloat(b)];
      if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y) || sign * a.localeCompare(b);
      return sign * (x - y);
    };
    body.append(...[...body.rows].sort((a, b) => compare(key(a), key(b))));
  }));
}
</script>
"#;

/// A table with heads to press. Heads and cells are HTML; each row has as many cells as there are heads.
pub fn sortable(heads: &[&str], rows: &[Vec<String>]) -> String {
    let heads: String =
        heads.iter().map(|head| format!(r#"<th scope="col"><button type="button">{head}</button></th>"#)).collect();
    let cells = |row: &Vec<String>| row.iter().map(|cell| format!("<td>{cell}</td>")).collect::<String>();
    let rows: String = rows.iter().map(|row| format!("<tr>{}</tr>", cells(row))).collect();
    format!(
        r#"<div class="scroll"><table class="sortable"><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>"#
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_head_can_be_pressed_and_each_cell_stands() {
        let rows = [["a", "1"], ["b", "2"], ["c", "3"]].map(|row| row.map(String::from).to_vec());
        let html = sortable(&["Way", "%"], &rows);
        assert_eq!(html.matches("<button").count(), 2);
        assert_eq!((html.matches("<tr>").count(), html.matches("<td>").count()), (1 + 3, 2 * 3));
    }
}
