//! The shipped layout for Foxglove and Lichtblick.

use std::collections::BTreeSet;

use serde_json::Value;
use tactile_live::parameters::FrameParameters;

const LAYOUT: &str = include_str!("../foxglove-layout.json");

/// What the node publishes, and the sensor's picture.
const TOPICS: [&str; 10] = [
    "/tactile_filter/belief",
    "/tactile_filter/diagnostics",
    "/tactile_filter/events",
    "/tactile_filter/felt",
    "/tactile_filter/image",
    "/tactile_filter/label",
    "/tactile_filter/next_action",
    "/tactile_filter/next_pose",
    "/tactile_filter/particles",
    "/tactile_filter/pose",
];

/// The panels in a tree of splits.
fn panels(tree: &Value, found: &mut BTreeSet<String>) {
    match tree {
        Value::String(panel) => assert!(found.insert(panel.clone()), "{panel} is there twice"),
        split => [&split["first"], &split["second"]].into_iter().for_each(|half| panels(half, found)),
    }
}

#[test]
fn each_panel_has_settings_and_each_topic_a_panel() {
    let layout: Value = serde_json::from_str(LAYOUT).unwrap();
    let mut placed = BTreeSet::new();
    panels(&layout["layout"], &mut placed);
    let set: BTreeSet<_> = layout["configById"].as_object().unwrap().keys().cloned().collect();
    assert_eq!(placed, set);
    for topic in TOPICS {
        assert!(LAYOUT.contains(&format!("\"{topic}")), "{topic} is in no panel");
    }
    assert_eq!(layout["configById"]["3D!belief"]["followTf"], FrameParameters::default().part.as_str());
}
