//! A running episode in a terminal: what is believed, where, and what the camera and the node say.
//!
//! [`View`] is what is shown, as plain data; [`draw`] makes a picture of it and changes nothing; [`run`] asks for views and
//! draws them until the user leaves.

mod draw;
mod follow;
mod heat;
mod terminal;
mod view;

pub use draw::draw;
pub use follow::Follower;
pub use terminal::{Feed, run};
pub use view::{Camera, Level, Message, Part, Place, PlaceMap, Pressed, View};
