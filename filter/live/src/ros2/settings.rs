//! How a ROS 2 user sets up a node: the words behind `--ros-args`, and the environment.

use std::path::PathBuf;

use super::error::{Error, Result};
use super::graph::Identifiers;
use super::names::{NodeName, Remap};

/// The words that ROS 2 passes to a node, apart from the program's own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Arguments {
    /// The program's own words, in order.
    pub own: Vec<String>,
    /// Rules of names, `__node` and `__ns` not among them.
    pub remaps: Vec<Remap>,
    /// Another name for the node (`-r __node:=NAME`).
    pub node: Option<String>,
    /// Its namespace (`-r __ns:=/NAME`).
    pub namespace: Option<String>,
    /// `-p NAME:=VALUE`, in order: of two for one name the later holds.
    pub parameters: Vec<Parameter>,
    /// `--params-file FILE`, in order; what `-p` says comes after them.
    pub parameter_files: Vec<PathBuf>,
}

/// One parameter of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// The node that it is for (`-p node:name:=value`); `None`: all.
    pub node: Option<String>,
    /// Its name.
    pub name: String,
    /// Its value in YAML, as written.
    pub value: String,
}

/// Flags of ROS 2 with a value, and without, that mean nothing here.
const IGNORED_WITH_VALUE: [&str; 4] = ["--log-level", "--log-config-file", "--enclave", "-e"];
const IGNORED: [&str; 6] = [
    "--enable-rosout-logs",
    "--disable-rosout-logs",
    "--enable-stdout-logs",
    "--disable-stdout-logs",
    "--enable-external-lib-logs",
    "--disable-external-lib-logs",
];

/// Reads a command line without the program's name. ROS 2's words stand between `--ros-args` and `--` or the end;
/// there may be several such groups.
///
/// # Errors
/// A flag that ROS 2 does not know, or one without its value.
pub fn arguments(words: impl IntoIterator<Item = String>) -> Result<Arguments> {
    let mut found = Arguments::default();
    let mut words = words.into_iter();
    let mut in_ros = false;
    while let Some(word) = words.next() {
        match word.as_str() {
            "--ros-args" => in_ros = true,
            _ if !in_ros => found.own.push(word),
            "--" => in_ros = false,
            flag if IGNORED.contains(&flag) => {}
            flag => {
                let value = words.next().ok_or_else(|| Error::invalid(flag, "a value behind it", ""))?;
                found.take(flag, value)?;
            }
        }
    }
    Ok(found)
}

impl Arguments {
    /// One flag and its value.
    fn take(&mut self, flag: &str, value: String) -> Result<()> {
        match flag {
            "-r" | "--remap" => {
                let rule = Remap::parse(&value)?;
                match rule.from.as_str() {
                    "__node" | "__name" => self.node = Some(rule.to),
                    "__ns" => self.namespace = Some(rule.to),
                    _ => self.remaps.push(rule),
                }
            }
            "-p" | "--param" => self.parameters.push(parameter(&value)?),
            "--params-file" => self.parameter_files.push(PathBuf::from(value)),
            flag if IGNORED_WITH_VALUE.contains(&flag) => {}
            flag => return Err(Error::invalid("--ros-args", "-r, -p or --params-file", flag)),
        }
        Ok(())
    }
}

fn parameter(text: &str) -> Result<Parameter> {
    let wrong = || Error::invalid("-p", "NAME:=VALUE", text);
    let (name, value) = text.split_once(":=").ok_or_else(wrong)?;
    let (node, name) = name.split_once(':').map_or((None, name), |(node, name)| (Some(node.to_owned()), name));
    if name.is_empty() {
        return Err(wrong());
    }
    Ok(Parameter { node, name: name.to_owned(), value: value.to_owned() })
}

/// What a [`Bus`](super::Bus) is opened with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The node's name and namespace.
    pub node: NodeName,
    /// The node's name before it was remapped, which rules for one node mean.
    pub own_name: String,
    /// Rules of names.
    pub remaps: Vec<Remap>,
    /// The domain: only nodes of the same one see each other. 0 to 232.
    pub domain_id: u16,
    /// Only programs on this machine, over 127.0.0.1.
    pub localhost_only: bool,
    /// How the graph's messages are laid out; `None`: as those of the first other node that is heard, and none is sent
    /// before.
    pub identifiers: Option<Identifiers>,
}

/// The last domain whose ports are below 65,536 (RTPS 2.5, 9.6.2.3).
const MAX_DOMAIN: u16 = 232;

impl Settings {
    /// The node `name` in `/`, in domain 0.
    ///
    /// # Errors
    /// A name that ROS 2 does not allow.
    pub fn new(name: &str) -> Result<Self> {
        Ok(Self {
            node: NodeName::new("/", name)?,
            own_name: name.to_owned(),
            remaps: Vec::new(),
            domain_id: 0,
            localhost_only: false,
            identifiers: None,
        })
    }

    /// The node `name` as the command line and the environment say; `variable` gives a variable of the environment:
    /// `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_NAMESPACE`, `ROS_DISTRO`.
    ///
    /// # Errors
    /// A name, a domain or a range that ROS 2 does not allow.
    pub fn from_words(name: &str, arguments: &Arguments, variable: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let set = |name| variable(name).filter(|value| !value.is_empty());
        let namespace = arguments.namespace.clone().or_else(|| set("ROS_NAMESPACE")).unwrap_or_else(|| "/".to_owned());
        let node = NodeName::new(&namespace, arguments.node.as_deref().unwrap_or(name))?;
        let domain_id = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => match text.parse::<u16>() {
                Ok(id) if id <= MAX_DOMAIN => id,
                _ => return Err(Error::invalid("ROS_DOMAIN_ID", "a number from 0 to 232", text)),
            },
        };
        let local_range = match set("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => false,
            Some("LOCALHOST") => true,
            // OFF would find nobody at all: no discovery but by addresses, which this middleware does not take.
            Some(other) => {
                return Err(Error::invalid("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET or LOCALHOST", other));
            }
        };
        let localhost_only = local_range || set("ROS_LOCALHOST_ONLY").is_some_and(|value| value == "1");
        let identifiers = set("ROS_DISTRO").and_then(|distro| Identifiers::of_distribution(&distro));
        let remaps = arguments.remaps.clone();
        Ok(Self { node, own_name: name.to_owned(), remaps, domain_id, localhost_only, identifiers })
    }

    /// The same in a network of this distribution of ROS 2; the environment is not asked.
    ///
    /// # Errors
    /// A name that is not known.
    pub fn in_distribution(self, name: &str) -> Result<Self> {
        let expected = "a distribution of ROS 2, such as humble or jazzy";
        let identifiers =
            Identifiers::of_distribution(name).ok_or_else(|| Error::invalid("ros_distro", expected, name))?;
        Ok(Self { identifiers: Some(identifiers), ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Result<Arguments> {
        arguments(text.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn the_words_of_ros_are_separated_from_the_programs_own() {
        let text = "live --seed 3 --ros-args -r a:=b --remap __ns:=/left -r __node:=touch -p rate:=2.5 --log-level info \
                    --params-file x.yaml --disable-stdout-logs -p n:k:=[1] -- --log l --ros-args -r c:=d";
        let found = words(text).unwrap();
        assert_eq!(found.own, ["live", "--seed", "3", "--log", "l"]);
        assert_eq!(found.remaps, ["a:=b", "c:=d"].map(|rule| Remap::parse(rule).unwrap()));
        assert_eq!((found.namespace.as_deref(), found.node.as_deref()), (Some("/left"), Some("touch")));
        assert_eq!(found.parameter_files, [PathBuf::from("x.yaml")]);
        let parameter = |node: Option<&str>, name: &str, value: &str| Parameter {
            node: node.map(str::to_owned),
            name: name.to_owned(),
            value: value.to_owned(),
        };
        assert_eq!(found.parameters, [parameter(None, "rate", "2.5"), parameter(Some("n"), "k", "[1]")]);
    }

    #[test]
    fn words_that_ros_does_not_know_are_refused() {
        for text in ["--ros-args -x y", "--ros-args -r", "--ros-args -r ab", "--ros-args -p a", "--ros-args a:=b"] {
            assert!(words(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_environment_says_domain_and_range() {
        let with = |name: &'static str, value: &'static str| {
            let variable = move |asked: &str| (asked == name).then(|| value.to_owned());
            Settings::from_words("f", &words("--ros-args -r __ns:=a").unwrap(), variable)
        };
        assert_eq!(with("ROS_DOMAIN_ID", "42").unwrap().domain_id, 42);
        assert_eq!(with("ROS_DOMAIN_ID", "").unwrap().domain_id, 0);
        assert_eq!(with("ROS_NAMESPACE", "b").unwrap().node.full(), "/a/f");
        assert!(with("ROS_DOMAIN_ID", "233").is_err() && with("ROS_DOMAIN_ID", "x").is_err());
        assert!(with("ROS_LOCALHOST_ONLY", "1").unwrap().localhost_only);
        assert!(!with("ROS_LOCALHOST_ONLY", "0").unwrap().localhost_only);
        assert!(with("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").unwrap().localhost_only);
        assert!(with("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF").is_err());
        let identifiers = |distro| with("ROS_DISTRO", distro).unwrap().identifiers;
        assert_eq!(identifiers("humble"), Some(Identifiers::Long));
        assert_eq!(identifiers("jazzy"), Some(Identifiers::Short));
        // What is not known is learned from others.
        assert_eq!((identifiers(""), identifiers("noetic")), (None, None));
        let settings = with("ROS_DISTRO", "jazzy").unwrap();
        assert_eq!(settings.clone().in_distribution("humble").unwrap().identifiers, Some(Identifiers::Long));
        assert!(settings.in_distribution("noetic").unwrap_err().to_string().contains("ros_distro"));
    }
}
