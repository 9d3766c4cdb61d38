//! Camera pictures as few pixels: JPEG of anybody's, within bounds.
//!
//! What a picture's head says is compared with bounds before anything is unpacked, by a walk of our
//! own ([`head`]); the pixels are zune-jpeg's.

mod error;
mod head;
mod jpeg;

pub use error::PictureError;
pub use jpeg::{Pixels, few_pixels};
