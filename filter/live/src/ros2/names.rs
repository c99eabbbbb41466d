//! Names of nodes, topics and services, as ROS 2 resolves them
//! (design.ros2.org, "Topic and Service name mapping to DDS" and "Remapping names").

use super::error::{Error, Result};

/// Longest name of a topic or service (rmw's `RMW_TOPIC_MAX_NAME_LENGTH`).
const MAX_LENGTH: usize = 247;

/// A node: where relative names begin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeName {
    /// Begins with `/`; `/` alone is the root.
    namespace: String,
    name: String,
}

impl NodeName {
    /// A node `name` in `namespace`, which may lack its first `/`.
    ///
    /// # Errors
    /// Characters that ROS 2 does not allow.
    pub fn new(namespace: &str, name: &str) -> Result<Self> {
        let expected = "letters, digits and _, no digit first";
        if !is_token(name) {
            return Err(Error::invalid("name of the node", expected, name));
        }
        let path = namespace.strip_prefix('/').unwrap_or(namespace);
        if !path.is_empty() && !path.split('/').all(is_token) {
            return Err(Error::invalid("namespace", "words of letters, digits and _ between /", namespace));
        }
        Ok(Self { namespace: format!("/{path}"), name: name.to_owned() })
    }

    /// The namespace; begins with `/`.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The name without its namespace.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// `/namespace/name`.
    pub fn full(&self) -> String {
        join(&self.namespace, &self.name)
    }

    /// A topic's or service's name in full: `/a` as it is, `~/a` below the node, `a` in its namespace. `{node}`, `{ns}`
    /// and `{namespace}` are replaced.
    ///
    /// # Errors
    /// A name that ROS 2 does not allow.
    pub fn resolve(&self, name: &str) -> Result<String> {
        let namespace = &self.namespace;
        let text = name.replace("{node}", &self.name).replace("{namespace}", namespace).replace("{ns}", namespace);
        let full = match text.as_bytes() {
            [b'/', ..] => text,
            [b'~'] => self.full(),
            [b'~', b'/', ..] => join(&self.full(), &text[2..]),
            _ => join(&self.namespace, &text),
        };
        let is_valid = full.strip_prefix('/').is_some_and(|path| path.split('/').all(is_token));
        if is_valid && full.len() <= MAX_LENGTH {
            Ok(full)
        } else {
            Err(Error::invalid("name", "a name of ROS 2: /a/b, a/b or ~/a", name))
        }
    }
}

/// One rule `from:=to`; a rule `node:from:=to` holds for nodes of that name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remap {
    /// The node that it is for; `None`: all.
    pub node: Option<String>,
    /// The name to replace, resolved by the node before it is compared.
    pub from: String,
    /// What replaces it.
    pub to: String,
}

impl Remap {
    /// Reads a rule.
    ///
    /// # Errors
    /// A text without `:=`, or with an empty side.
    pub fn parse(rule: &str) -> Result<Self> {
        let wrong = || Error::invalid("-r", "FROM:=TO", rule);
        let (from, to) = rule.split_once(":=").ok_or_else(wrong)?;
        // rostopic:// and rosservice:// would narrow a rule to one kind; here both kinds follow it.
        let from = from.strip_prefix("rostopic://").or(from.strip_prefix("rosservice://")).unwrap_or(from);
        let (node, from) = from.split_once(':').map_or((None, from), |(node, from)| (Some(node.to_owned()), from));
        if from.is_empty() || to.is_empty() || node.as_deref() == Some("") {
            return Err(wrong());
        }
        Ok(Self { node, from: from.to_owned(), to: to.to_owned() })
    }
}

/// `name` resolved by `node`, then replaced by the first rule of `remaps` that fits. `own_name` is the node's name
/// before it was itself remapped: rules for one node mean that.
///
/// # Errors
/// A name that ROS 2 does not allow, in `name` or in a rule that fits.
pub fn resolve(node: &NodeName, own_name: &str, remaps: &[Remap], name: &str) -> Result<String> {
    let full = node.resolve(name)?;
    for rule in remaps.iter().filter(|rule| rule.node.as_deref().is_none_or(|of| of == own_name)) {
        if node.resolve(&rule.from).is_ok_and(|from| from == full) {
            return node.resolve(&rule.to);
        }
    }
    Ok(full)
}

/// The type's name on the wire: `sensor_msgs/msg/Image` is `sensor_msgs::msg::dds_::Image_`; `part` is what follows the
/// name for a service's messages (`_Request`, `_Response`).
///
/// # Errors
/// Another form than `package/msg/Name`.
pub fn dds_type(ros_type: &str, part: &str) -> Result<String> {
    let words: Vec<_> = ros_type.split('/').collect();
    match words[..] {
        [package, kind, name] if [package, kind, name].into_iter().all(is_token) => {
            Ok(format!("{package}::{kind}::dds_::{name}{part}_"))
        }
        _ => Err(Error::invalid("type", "package/msg/Name", ros_type)),
    }
}

fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

/// One word of a name.
fn is_token(token: &str) -> bool {
    let mut bytes = token.bytes();
    bytes.next().is_some_and(|b| b.is_ascii_alphabetic() || b == b'_')
        && bytes.all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of "Topic and Service name mapping to DDS", section "Name tokens", for a node `/ns/node`.
    #[test]
    fn names_resolve_as_in_the_design_of_ros_2() {
        let node = NodeName::new("/ns", "node").unwrap();
        for (name, full) in [
            ("ping", "/ns/ping"),
            ("/ping", "/ping"),
            ("~", "/ns/node"),
            ("~/ping", "/ns/node/ping"),
            ("a/b", "/ns/a/b"),
            ("{node}/ping", "/ns/node/ping"),
            ("{ns}/{node}/ping", "/ns/node/ping"),
        ] {
            assert_eq!(node.resolve(name).unwrap(), full, "{name}");
        }
        assert_eq!(NodeName::new("", "node").unwrap().resolve("~/a").unwrap(), "/node/a");
        assert_eq!(NodeName::new("/", "node").unwrap().resolve("a").unwrap(), "/a");
        for name in ["", "/", "a/", "a//b", "1a", "a/2", "~a", "a b", "a-b", "/a/~", "{x}"] {
            assert!(node.resolve(name).is_err(), "{name}");
        }
    }

    #[test]
    fn nodes_have_plain_names() {
        assert_eq!(NodeName::new("a/b", "n").unwrap().full(), "/a/b/n");
        for (namespace, name) in [("/a/", "n"), ("//a", "n"), ("/1", "n"), ("/", ""), ("/", "a/b"), ("/", "9")] {
            assert!(NodeName::new(namespace, name).is_err(), "{namespace} {name}");
        }
    }

    #[test]
    fn the_first_rule_that_fits_is_taken_and_names_are_compared_in_full() {
        let node = NodeName::new("/left", "filter").unwrap();
        let rules: Vec<_> = ["~/image:=/gelsight/image_raw", "other:pose:=/x", "f:pose:=arm/pose", "pose:=/second"]
            .iter()
            .map(|rule| Remap::parse(rule).unwrap())
            .collect();
        let resolved = |name| resolve(&node, "f", &rules, name).unwrap();
        assert_eq!(resolved("~/image"), "/gelsight/image_raw");
        assert_eq!(resolved("/left/filter/image"), "/gelsight/image_raw");
        assert_eq!(resolved("pose"), "/left/arm/pose");
        assert_eq!(resolved("/pose"), "/pose");
        for rule in ["a", ":=b", "a:=", ":a:=b"] {
            assert!(Remap::parse(rule).is_err(), "{rule}");
        }
    }

    #[test]
    fn types_are_named_as_on_the_wire() {
        assert_eq!(dds_type("sensor_msgs/msg/Image", "").unwrap(), "sensor_msgs::msg::dds_::Image_");
        let request = dds_type("std_srvs/srv/Trigger", "_Request").unwrap();
        assert_eq!(request, "std_srvs::srv::dds_::Trigger_Request_");
        assert!(dds_type("sensor_msgs/Image", "").is_err());
    }
}
