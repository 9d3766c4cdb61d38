//! Recordings of any format: channels, messages, time and index; traits to read and to write one.
//!
//! Who plays or records knows [`Recording`], [`RecordingWriter`] and [`RecordingFormat`] alone;
//! a crate for each format has types that are these.
//!
//! Not for: bytes of files, or compression, which belong to a format's own crate.
#![forbid(unsafe_code)]

mod checked;
mod copy;
mod definition;
mod error;
mod in_force;
mod index;
mod model;
mod packed;
mod reading;
mod timeline;
mod window;
mod writing;

pub use checked::{Checked, mixed_types};
pub use copy::copy;
pub use definition::{another_type, different_field, field, is_interface_file};
pub use error::RecordingError;
pub use in_force::{
    LatchedState, Latcher, Late, MOST_IN_FORCE, TRANSFORMS_IN_FORCE, latched_depths, latchers,
};
pub use index::{Index, Publisher, Reason, Refusal, Span};
pub use model::{Connection, Loss, Message, MessageEncoding, SchemaEncoding};
pub use packed::packed;
pub use reading::Recording;
pub use timeline::{Place, Timeline};
pub use window::Window;
pub use writing::{RecordingFormat, RecordingWriter};
