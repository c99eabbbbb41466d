//! A map of probabilities in half blocks: two square pixels in a character.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use tactile_data::pose::se2::Se2;

use super::view::PlaceMap;

/// From nothing to the largest value, in the palette of 256 colours that every terminal and multiplexer has.
const COLOURS: [u8; 14] = [234, 17, 18, 19, 25, 31, 37, 36, 71, 107, 143, 185, 221, 229];

/// Something to mark on a map.
pub struct Mark {
    /// Where, mm.
    pub at: [f64; 2],
    /// What is written there.
    pub glyph: char,
    /// How.
    pub colour: Color,
}

/// Arrows of a heading, from x towards y: to the right, then turning clockwise as seen on the screen.
const ARROWS: [char; 8] = ['→', '↘', '↓', '↙', '←', '↖', '↑', '↗'];

/// The arrow nearest to a pose's heading.
pub fn arrow(pose: &Se2) -> char {
    let eighths = (pose.theta_deg() / 45.0).round();
    if eighths.is_finite() { ARROWS[(eighths as i64).rem_euclid(8) as usize] } else { '?' }
}

/// Draws a map as large as it fits, in the middle of `area`, and the marks on it; the later marks over the earlier.
/// Marks outside the map are at its border, in the same colour.
pub fn draw(map: &PlaceMap, marks: &[Mark], area: Rect, buffer: &mut Buffer) {
    let side = area.width.min(area.height.saturating_mul(2)) / 2 * 2;
    if side < 2 || map.n_xy == 0 {
        return;
    }
    let square = Rect {
        x: area.x + (area.width - side) / 2,
        y: area.y + (area.height - side / 2) / 2,
        width: side,
        height: side / 2,
    };
    // The outermost cells reach half a step beyond their centres.
    let reach = map.half_mm + map.half_mm / (map.n_xy as f64 - 1.0).max(1.0);
    let mm = |pixel: u16| (f64::from(pixel) + 0.5) / f64::from(side) * 2.0 * reach - reach;
    let largest = map.largest();
    let colour = |column: u16, row: u16| colour(map.at(mm(column), mm(row)), largest);
    for (column, row) in (0..side).flat_map(|column| (0..side / 2).map(move |row| (column, row))) {
        let style = Style::new().fg(colour(column, 2 * row)).bg(colour(column, 2 * row + 1));
        buffer[(square.x + column, square.y + row)].set_char('▀').set_style(style);
    }
    for Mark { at, glyph, colour: of_mark } in marks.iter().filter(|mark| mark.at.iter().all(|mm| mm.is_finite())) {
        let pixel =
            at.map(|mm| ((mm + reach) / (2.0 * reach) * f64::from(side)).clamp(0.0, f64::from(side - 1)) as u16);
        let style = Style::new().fg(*of_mark).bg(Color::Black).add_modifier(Modifier::BOLD);
        buffer[(square.x + pixel[0], square.y + pixel[1] / 2)].set_char(*glyph).set_style(style);
    }
}

/// The colour of a value: the root of its share, so that what is a hundredth of the largest is still seen.
fn colour(value: f64, largest: f64) -> Color {
    let share = if largest > 0.0 { (value / largest).clamp(0.0, 1.0).sqrt() } else { 0.0 };
    Color::Indexed(COLOURS[(share * (COLOURS.len() - 1) as f64).round() as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_has_an_arrow_clockwise_from_the_right() {
        let of = |degrees: f64| arrow(&Se2::from_degrees(0.0, 0.0, degrees));
        assert_eq!([of(0.0), of(44.0), of(90.0), of(180.0), of(-90.0), of(-30.0)], ['→', '↘', '↓', '←', '↑', '↗']);
        assert_eq!(arrow(&Se2::new(0.0, 0.0, f64::NAN)), '?');
    }

    #[test]
    fn the_largest_value_is_brightest_where_it_is() {
        let mut values = vec![0.0; 25];
        values[4 * 5 + 1] = 0.3; // x: the last of five columns; y: the second of five rows
        let map = PlaceMap { n_xy: 5, half_mm: 4.0, values };
        let mut buffer = Buffer::empty(Rect::new(0, 0, 14, 5));
        draw(&map, &[], buffer.area, &mut buffer);
        // Ten columns and five rows of two pixels each, in the middle: two pixels a cell.
        let rank = |colour| COLOURS.iter().position(|index| Color::Indexed(*index) == colour).unwrap_or(0);
        let brightness = |at: &(u16, u16)| rank(buffer[*at].fg).max(rank(buffer[*at].bg));
        let all = (0..14).flat_map(|x| (0..5).map(move |y| (x, y)));
        let most = all.clone().map(|at| brightness(&at)).max().unwrap();
        let brightest: Vec<_> = all.filter(|at| brightness(at) == most).collect();
        let is_in_cell = |(x, y): &(u16, u16)| (10..12).contains(x) && *y == 1;
        assert!(most > 8 && brightest.iter().all(is_in_cell), "{brightest:?}");
        assert_eq!([buffer[(1, 0)].symbol(), buffer[(2, 0)].symbol(), buffer[(12, 0)].symbol()], [" ", "▀", " "]);
    }

    #[test]
    fn a_mark_is_where_its_place_is_and_outside_at_the_border() {
        let map = PlaceMap { n_xy: 5, half_mm: 4.0, values: vec![0.0; 25] };
        let mut buffer = Buffer::empty(Rect::new(0, 0, 10, 5));
        let mark = |x, y, glyph| Mark { at: [x, y], glyph, colour: Color::White };
        let marks = [mark(0.0, 0.0, 'm'), mark(4.0, -4.0, 'c'), mark(99.0, 99.0, 'o'), mark(f64::NAN, 0.0, 'n')];
        draw(&map, &marks, buffer.area, &mut buffer);
        assert_eq!([buffer[(5, 2)].symbol(), buffer[(9, 0)].symbol(), buffer[(9, 4)].symbol()], ["m", "c", "o"]);
        assert!(buffer.content.iter().all(|cell| cell.symbol() != "n"));
    }
}
