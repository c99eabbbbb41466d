//! Tests of [`super`]: text in every form, and what is wrong in it.

use super::*;

/// A folder with the pictures that the tests name; their content is not looked at.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("A/hole")).unwrap();
    for file in ["1.png", "2.png", "a, b.png", "A/hole/3.png"] {
        std::fs::write(folder.path().join(file), "").unwrap();
    }
    folder
}

fn rows(bytes: &[u8]) -> Result<Vec<Row>> {
    let folder = folder();
    let rows = read(Path::new("index.csv"), bytes, folder.path())?;
    let relative = |file: PathBuf| file.strip_prefix(folder.path()).unwrap().to_path_buf();
    let relative = |row: Row| Row { file: row.file.map(relative), ..row };
    Ok(rows.into_iter().map(relative).collect())
}

fn file(row: &Row) -> &str {
    row.file.as_ref().unwrap().to_str().unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    let message = rows(bytes).unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    message
}

#[test]
fn commas_semicolons_tabs_and_json_lines_say_the_same() {
    let header = COLUMNS.join(",");
    let comma = format!("{header}\n1.png,A,hole,1.5,-2,30,0.5,0,1e1,p1,7,12.25\n2.png,,,,,,,,,,,\n");
    let semicolon = comma.replace(',', ";").replace("1.5;", "1,5;").replace("12.25", "12,25");
    let tab = comma.replace(',', "\t").replace('\n', "\r\n");
    let json = r#"{"file": "1.png", "part": "A", "side": "hole", "x_mm": 1.5, "y_mm": -2, "theta_deg": 30,
        "moved_x_mm": 0.5, "moved_y_mm": 0, "moved_theta_deg": 10, "pair": "p1", "episode": 7, "time_s": 12.25}"#;
    let json = format!("{}\n{{\"file\": \"2.png\", \"part\": \"\", \"x_mm\": null}}\n", json.replace('\n', " "));
    let touch = Touch {
        part: Some("A".into()),
        side: Some(Side::Hole),
        part_from_sensor: Some(Se2::from_degrees(1.5, -2.0, 30.0)),
        moved: Some(Se2::from_degrees(0.5, 0.0, 10.0)),
        pair: Some("p1".into()),
        episode: Some("7".into()),
        time_s: Some(12.25),
    };
    for (text, first_line) in [(&comma, 2), (&semicolon, 2), (&tab, 2), (&json, 1)] {
        let place = |number| Place { file: Path::new("index.csv").into(), unit: "line", number };
        let row =
            |line, file: &str, touch: &Touch| Row { place: place(line), file: Some(file.into()), touch: touch.clone() };
        let expected = [row(first_line, "1.png", &touch), row(first_line + 1, "2.png", &Touch::default())];
        assert_eq!(rows(text.as_bytes()).unwrap(), expected, "{text}");
    }
}

#[test]
fn byte_order_marks_quotes_blank_lines_and_a_named_separator_are_read() {
    let text = "\u{feff}\"file\",\"part\"\r\n\"a, b.png\",\"say \"\"A\"\"\"\r\n\r\n1.png,\r\n";
    let got = rows(text.as_bytes()).unwrap();
    assert_eq!((file(&got[0]), got[0].touch.part.as_deref()), ("a, b.png", Some("say \"A\"")));
    assert_eq!((got[1].place.number, &got[1].touch.part), (4, &None));
    let got = rows(b"sep=;\nfile;x_mm;y_mm;theta_deg\n1.png;1,5;2;3\n").unwrap();
    assert_eq!((got[0].place.number, got[0].touch.part_from_sensor.unwrap().x_mm), (3, 1.5));
    assert!(refusal(b"file\na\\b.png\n").contains("no such file"));
    assert_eq!(file(&rows(b"file\nA\\hole\\3.png\n").unwrap()[0]), "A/hole/3.png");
    assert_eq!(file(&rows(b"file\n./A/../1.png\n").unwrap()[0]), "1.png");
}

#[test]
fn bad_rows_are_named_with_their_cell() {
    for (row, expected) in [
        ("9.png,1,2,3,", "9.png, got no such file"),
        (",1,2,3,", "the name of a file"),
        ("1.png,1,,3,", "x_mm, y_mm, theta_deg: expected all three numbers or none"),
        ("1.png,1,2", "3 cells under 5 columns"),
        ("1.png,1,2,east,", "theta_deg: expected a number, got east"),
        ("1.png,\"1,5\",2,3,", "x_mm: expected a number, got 1,5"),
        ("1.png,nan,1,1,", "x_mm: expected a number, got nan"),
        ("1.png,inf,1,1,", "x_mm: expected a number, got inf"),
        ("1.png,1e300,0,0,", "at most 10000 mm"),
        ("1.png,1,2,1e9,", "3600 degrees"),
        ("1.png,,,,1e300", "time_s: expected seconds"),
        ("1.png,,,,nan", "time_s: expected a number"),
        ("1.png,,,,1.7e18", "time_s: expected seconds, at most 10000000000 from zero"),
    ] {
        let message = refusal(format!("file,x_mm,y_mm,theta_deg,time_s\n2.png,0,0,0,\n{row}\n").as_bytes());
        assert!(message.contains(expected) && message.starts_with("index.csv line 3"), "{message}");
    }
    for (row, expected) in [
        (r#"{"file": "1.png", "x_mm": 1e999}"#, "number out of range"),
        (r#"{"file": "1.png", "x_mm": NaN}"#, "expected value at column"),
        (r#"{"file": "1.png", "file": "2.png"}"#, "duplicate field"),
        (r#"{"file": "1.png", "angle": 3}"#, "unknown field `angle`"),
        (r#"{"file": "1.png", "side": "left"}"#, "side: expected hole or peg, got left"),
        (r#"{"file": "1.png""#, "EOF"),
        (r#"[1]"#, "line 2"),
    ] {
        let message = refusal(format!("{{\"file\": \"2.png\"}}\n{row}\n").as_bytes());
        assert!(message.contains(expected) && message.starts_with("index.csv line 2"), "{message}");
    }
}

#[test]
fn bad_headers_and_encodings_are_named() {
    for (text, expected) in [
        (&b"file,angle\n1.png,3\n"[..], "line 1: expected file, part"),
        (b"file,theta_dg\n1.png,3\n", "did you mean theta_deg?"),
        (b"part,side\nA,hole\n", "a column file"),
        (b"file,part,part\n1.png,A,B\n", "part twice"),
        (b"file\n", "at least one row that names a file"),
        (b"", "a column file, got none"),
        (b"\xff\xfef\0i\0", "UTF-16"),
        (b"file\n\xe4.png\n", "line 2: expected text in UTF-8"),
        (b"file;x_mm;y_mm;theta_deg\n1.png;1.234,5;0;0\n", "got 1.234,5"),
    ] {
        let message = refusal(text);
        assert!(message.contains(expected), "{message}");
    }
}
