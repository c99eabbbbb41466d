//! Rules for the documents' tables: their figures are those of `figures.json`, of the shipped model, and of code that is
//! known and new enough.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use clap::ValueEnum;

use super::Finding;
use crate::code::{Code, git};
use crate::error::{Error, Result};
use crate::experiments::{self, Experiments, Part};
use crate::figures::table::Table;
use crate::figures::{self, Evaluated, Figures, document, model};
use crate::reproduce::{Job, steps};
use crate::workspace::Workspace;

/// How old a commit is.
#[derive(Clone, Debug, PartialEq)]
enum Age {
    /// As old as the other, or newer.
    Newer,
    /// Older than the other, or of another branch.
    Older,
    /// Not in the history of the code at hand.
    Foreign,
    /// Not to be checked, for this reason.
    Unchecked(String),
}

/// Checks the figures of the workspace and their tables in these files.
pub fn check(workspace: &Workspace, files: &[String]) -> Result<Vec<Finding>> {
    let (experiments, figures) = (Experiments::read(workspace)?, Figures::read(workspace)?);
    let shipped = workspace.shipped_model();
    let steps = steps(&Job::whole(workspace, &experiments, &shipped), Part::value_variants())?;
    let names: Vec<&str> = steps.iter().map(|step| step.name.as_str()).collect();
    let mut findings = evaluations(&experiments.tables, &names)?;
    if !findings.is_empty() {
        return Ok(findings);
    }
    findings.extend(models(&experiments.tables, &figures, &model::identity(&shipped)?)?);
    let mut ages = BTreeMap::new();
    let mut age = |since: &str, commit: &str| -> Age {
        let of = (since.to_owned(), commit.to_owned());
        ages.entry(of).or_insert_with(|| age(&workspace.root, since, commit)).clone()
    };
    findings.extend(codes(&experiments.tables, &figures, &mut age)?);
    let unchecked = ages.into_values().find_map(|age| if let Age::Unchecked(why) = age { Some(why) } else { None });
    if let Some(why) = unchecked {
        println!("tidy: how old the figures are could not be checked: {why}");
    }
    let mut there = BTreeSet::new();
    for path in files.iter().filter(|path| path.ends_with(".md")) {
        let full = workspace.root.join(path);
        let text = fs::read_to_string(&full).map_err(Error::io(&full))?;
        there.extend(document::marked(path, &text)?.into_iter().map(|marked| marked.name.to_owned()));
        findings.extend(tables(path, &text, &experiments.tables, &figures)?);
    }
    let nowhere = experiments.tables.iter().filter(|table| !there.contains(&table.name));
    findings.extend(nowhere.map(|table| of_file(format!("table {} is in no document", table.name))));
    Ok(findings)
}

/// A finding of the experiments' file.
fn of_file(what: String) -> Finding {
    Finding::new(experiments::FILE, 1, what)
}

/// Evaluations of tables that no experiment runs; `names` are those of the steps.
fn evaluations(tables: &[Table], names: &[&str]) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for table in tables {
        let wanted: BTreeSet<String> = table.selected()?.into_iter().map(|selected| selected.evaluation).collect();
        let unknown = wanted.iter().filter(|name| !names.contains(&name.as_str()));
        findings.extend(unknown.map(|name| of_file(format!("table {}: no experiment is called {name}", table.name))));
    }
    Ok(findings)
}

/// The evaluations of a table that have figures.
fn of_table<'a>(table: &Table, figures: &'a Figures) -> Result<BTreeMap<&'a str, &'a Evaluated>> {
    let selected = table.selected()?.into_iter();
    let found = selected.filter_map(|selected| figures.evaluations.get_key_value(&selected.evaluation));
    Ok(found.map(|(name, evaluated)| (name.as_str(), evaluated)).collect())
}

/// Tables of the shipped model that have figures of another.
fn models(tables: &[Table], figures: &Figures, shipped: &str) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for table in tables.iter().filter(|table| table.is_of_shipped_model) {
        let others = of_table(table, figures)?.into_iter().filter(|(_, evaluated)| evaluated.model != shipped);
        let others: Vec<&str> = others.map(|(name, _)| name).collect();
        if !others.is_empty() {
            findings.push(of_figures(table, &others, &format!("of another model than the shipped one, {shipped:.12}")));
        }
    }
    Ok(findings)
}

/// Tables that say since when their figures are, and have figures of code that is not known, not committed, or older.
fn codes(tables: &[Table], figures: &Figures, age: &mut dyn FnMut(&str, &str) -> Age) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for table in tables {
        let Some(since) = &table.since else { continue };
        let mut wrong: BTreeMap<String, Vec<&str>> = BTreeMap::new();
        for (name, evaluated) in of_table(table, figures)? {
            let what = match &evaluated.code {
                Code::Unknown { unknown } => format!("of code that is not known: {unknown}"),
                Code::Commit { commit, dirty: true } => format!("of code that differed from commit {commit:.12}"),
                Code::Commit { commit, dirty: false } => match age(since, commit) {
                    Age::Older => format!("of commit {commit:.12}, which is older than {since:.12}"),
                    Age::Foreign => format!("of commit {commit:.12}, which is not in the history"),
                    Age::Newer | Age::Unchecked(_) => continue,
                },
            };
            wrong.entry(what).or_default().push(name);
        }
        findings.extend(wrong.iter().map(|(what, names)| of_figures(table, names, what)));
    }
    Ok(findings)
}

/// A finding of the figures' file: what some evaluations of a table are.
fn of_figures(table: &Table, names: &[&str], what: &str) -> Finding {
    let more = if names.len() > 1 { format!(" and {} more", names.len() - 1) } else { String::new() };
    let first = names.first().unwrap_or(&"");
    Finding::new(figures::FILE, 1, format!("table {}: {first}{more}: {what}", table.name))
}

/// Marked tables of a document that have other lines than their figures give.
fn tables(path: &str, text: &str, tables: &[Table], figures: &Figures) -> Result<Vec<Finding>> {
    let mut findings = Vec::new();
    for marked in document::marked(path, text)? {
        let Some(table) = tables.iter().find(|table| table.name == marked.name) else {
            findings.push(Finding::new(path, marked.line, format!("no table is called {}", marked.name)));
            continue;
        };
        let expected = table.markdown(figures)?;
        if let Some(at) = (0..expected.len().max(marked.lines.len()))
            .find(|at| expected.get(*at).map(String::as_str) != marked.lines.get(*at).copied())
        {
            let expected = expected.get(at).map_or("no line", String::as_str);
            let what = format!("not what {} gives (cargo xtask figures writes it): expected {expected}", figures::FILE);
            findings.push(Finding::new(path, marked.line + 1 + at, what));
        }
    }
    Ok(findings)
}

/// How old a commit is next to `since`, as git knows it.
fn age(root: &Path, since: &str, commit: &str) -> Age {
    match git(root, "rev-parse --show-prefix --is-shallow-repository").as_deref() {
        Ok("\nfalse") => {}
        Ok(_) => return Age::Unchecked("not a repository of its own with its whole history".into()),
        Err(why) => return Age::Unchecked(format!("git: {why}")),
    }
    if git(root, &format!("cat-file -e {since}^{{commit}}")).is_err() {
        return Age::Unchecked(format!("the history does not go back to {since:.12}"));
    }
    let is_ancestor =
        |older: &str, newer: &str| git(root, &format!("merge-base --is-ancestor {older} {newer}")).is_ok();
    match (is_ancestor(commit, "HEAD"), is_ancestor(since, commit)) {
        (false, _) => Age::Foreign,
        (true, true) => Age::Newer,
        (true, false) => Age::Older,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::table::tests::{figures, table};
    use crate::workspace::remove;

    fn lines(findings: Result<Vec<Finding>>) -> Vec<String> {
        findings.unwrap().iter().map(ToString::to_string).collect()
    }

    fn committed(dirty: bool) -> Code {
        Code::Commit { commit: "a".repeat(40), dirty }
    }

    #[test]
    fn a_table_that_somebody_typed_is_found() {
        let (tables_, figures) = ([table()], figures(&committed(false)));
        let right = format!(
            "x\n<!-- figures: reach -->\n{}\n<!-- end of figures -->\n",
            tables_[0].markdown(&figures).unwrap().join("\n")
        );
        assert!(tables("R.md", &right, &tables_, &figures).unwrap().is_empty());
        let typed = right.replace("88.4; 100.0", "98.4; 100.0");
        let expected = "R.md:5: not what filter/eval/figures.json gives (cargo xtask figures writes it): expected \
                        | both | 88.4; 100.0 | 3.0, – |";
        assert_eq!(lines(tables("R.md", &typed, &tables_, &figures)), [expected]);
        let cut = right.replace("| *the paper* | *39.6* | |\n", "");
        assert_eq!(lines(tables("R.md", &cut, &tables_, &figures)).len(), 1);
        let other = right.replace("figures: reach", "figures: rich");
        assert_eq!(lines(tables("R.md", &other, &tables_, &figures)), ["R.md:2: no table is called rich"]);
    }

    #[test]
    fn figures_of_another_model_are_found_where_the_shipped_one_is_claimed() {
        let (mut tables, figures) = ([table()], figures(&committed(false)));
        assert!(models(&tables, &figures, "m").unwrap().is_empty());
        let expected =
            "filter/eval/figures.json:1: table reach: large and 1 more: of another model than the shipped one, n";
        assert_eq!(lines(models(&tables, &figures, "n")), [expected]);
        tables[0].is_of_shipped_model = false;
        assert!(models(&tables, &figures, "n").unwrap().is_empty());
    }

    #[test]
    fn figures_of_code_that_is_unknown_uncommitted_or_old_are_found() {
        let tables = [table()];
        let found = |code: Code, age: Age| lines(codes(&tables, &figures(&code), &mut |_, _| age.clone()));
        let start = "filter/eval/figures.json:1: table reach: large and 1 more: of";
        for (code, age, expected) in [
            (Code::unknown("git: none"), Age::Newer, "code that is not known: git: none"),
            (committed(true), Age::Newer, "code that differed from commit aaaaaaaaaaaa"),
            (committed(false), Age::Older, "commit aaaaaaaaaaaa, which is older than bbbbbbbbbbbb"),
            (committed(false), Age::Foreign, "commit aaaaaaaaaaaa, which is not in the history"),
        ] {
            assert_eq!(found(code, age), [format!("{start} {expected}")]);
        }
        for age in [Age::Newer, Age::Unchecked("a shallow clone".into())] {
            assert!(found(committed(false), age).is_empty());
        }
        // A table that says no commit claims nothing of the code.
        let mut claims_nothing = table();
        claims_nothing.since = None;
        let unknown = figures(&Code::unknown("git: none"));
        assert!(codes(&[claims_nothing], &unknown, &mut |_, _| Age::Older).unwrap().is_empty());
    }

    #[test]
    fn an_evaluation_that_nobody_runs_is_found() {
        assert!(evaluations(&[table()], &["small", "large"]).unwrap().is_empty());
        let expected = "filter/eval/experiments.toml:1: table reach: no experiment is called large";
        assert_eq!(lines(evaluations(&[table()], &["small"])), [expected]);
    }

    #[test]
    fn an_age_is_of_the_history_and_without_one_there_is_none() {
        let folder = std::env::temp_dir().join(format!("xtask-age-{}", std::process::id()));
        remove(&folder).unwrap();
        fs::create_dir_all(&folder).unwrap();
        let git = |words: &str| git(&folder, &format!("-c user.name=a -c user.email=a@b {words}")).unwrap();
        assert!(matches!(age(&folder, "a", "b"), Age::Unchecked(_)));
        git("init --quiet");
        let commit = || {
            git("commit --quiet --allow-empty --message some");
            git("rev-parse HEAD")
        };
        let [first, second] = [commit(), commit()];
        git("checkout --quiet --detach HEAD");
        let aside = commit();
        git(&format!("checkout --quiet --detach {second}"));
        assert_eq!(age(&folder, &first, &second), Age::Newer);
        assert_eq!(age(&folder, &second, &second), Age::Newer);
        assert_eq!(age(&folder, &second, &first), Age::Older);
        assert_eq!(age(&folder, &first, &aside), Age::Foreign);
        assert_eq!(age(&folder, &first, &"0".repeat(40)), Age::Foreign);
        assert!(matches!(age(&folder, &"0".repeat(40), &second), Age::Unchecked(_)));
        git(&format!("clone --quiet --depth 1 file://{} shallow", folder.display()));
        assert!(matches!(age(&folder.join("shallow"), &first, &second), Age::Unchecked(_)));
        remove(&folder).unwrap();
    }
}
