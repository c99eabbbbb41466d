//! The commands of the documents: each names a program, a subcommand and options that exist.

use std::collections::BTreeSet;
use std::fs;

use tactile_tests::programs::{run, workspace};

/// A program of ours and its arguments.
pub(crate) type CommandLine = (String, Vec<String>);

/// The command lines in the `sh` blocks of a markdown text that run a program of this workspace.
pub(crate) fn commands(markdown: &str) -> Vec<CommandLine> {
    let blocks = markdown.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n"));
    let lines: Vec<String> =
        blocks.flat_map(|block| block.replace("\\\n", " ").lines().map(str::to_owned).collect::<Vec<_>>()).collect();
    lines.iter().flat_map(|line| line.split("&&")).filter_map(command).collect()
}

fn command(line: &str) -> Option<CommandLine> {
    let ends = |word: &&str| !word.starts_with(['#', '|', '>', '<', ';']);
    let words: Vec<&str> = line.trim().trim_start_matches("$ ").split_whitespace().take_while(ends).collect();
    let owned = |words: &[&str]| words.iter().map(ToString::to_string).collect();
    match words.as_slice() {
        ["cargo", "xtask", args @ ..] => Some(("xtask".into(), owned(args))),
        ["cargo", "run", args @ ..] if args.contains(&"--example") => None,
        ["cargo", "run", args @ ..] => {
            let split = args.iter().position(|word| *word == "--").unwrap_or(args.len());
            let named = |pair: &[&str]| ["-p", "--package", "--bin"].contains(&pair[0]).then(|| pair[1].to_owned());
            let program = args[..split].windows(2).find_map(named);
            Some((
                program.unwrap_or_else(|| panic!("no -p in {line}")),
                owned(args.get(split + 1..).unwrap_or_default()),
            ))
        }
        [program, args @ ..] => {
            let name = program.rsplit('/').next()?;
            name.starts_with("tactile-").then(|| (name.to_owned(), owned(args)))
        }
        [] => None,
    }
}

/// The long options of a command line that its program does not have; an unknown program or subcommand panics.
fn unknown_options((program, args): &CommandLine) -> Vec<String> {
    let subcommands = args.iter().take_while(|word| !word.starts_with('-')).map(String::as_str);
    let help = run(program, &workspace(), &subcommands.chain(["--help"]).collect::<Vec<_>>());
    let is_part_of_a_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
    let known: BTreeSet<&str> = help.done().split(|c| !is_part_of_a_name(c)).collect();
    let options = args.iter().filter(|word| word.starts_with("--")).map(|word| word.split('=').next().unwrap_or(word));
    options.filter(|option| !known.contains(option)).map(str::to_owned).collect()
}

/// The documents whose commands a user pastes.
const DOCUMENTS: [&str; 10] = [
    "README.md",
    "data/README.md",
    "data/recording-template/README.md",
    "data/your-sensor/README.md",
    "infer/README.md",
    "train/README.md",
    "filter/eval/README.md",
    "filter/live/README.md",
    "filter/capi/README.md",
    "CONTRIBUTING.md",
];

#[test]
fn every_command_of_the_documents_exists() {
    for document in DOCUMENTS {
        let text = fs::read_to_string(workspace().join(document)).unwrap();
        let commands = commands(&text);
        assert!(!commands.is_empty(), "{document}");
        for command in &commands {
            assert_eq!(unknown_options(command), Vec::<String>::new(), "{document}: {command:?}");
        }
    }
}

#[test]
fn an_option_that_does_not_exist_is_found() {
    let text = "```sh\ncargo run --release -p tactile-data -- \\\n  generate --scene maze --speed=3 --seed 1 # --not-this\n\
                cargo xtask demo --quick && target/release/tactile-train --data x --haste\ngit clone --here\n```\n\
                ```text\ncargo xtask dance\n```\n";
    let commands = commands(text);
    let programs: Vec<_> = commands.iter().map(|(program, _)| program.as_str()).collect();
    assert_eq!(programs, ["tactile-data", "xtask", "tactile-train"]);
    let unknown: Vec<_> = commands.iter().map(unknown_options).collect();
    assert_eq!(unknown, [vec!["--speed"], vec![], vec!["--haste"]]);
}
