//! Why a picture is not shown.

/// Why there are no pixels.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum PictureError {
    /// The bytes are something else.
    #[error("it is no JPEG")]
    NotJpeg,
    /// A kind of JPEG that is not unpacked, or none.
    #[error("its JPEG is not shown: {0}")]
    Unknown(&'static str),
    /// More than a picture may be, by its own head.
    #[error("its JPEG has {width} x {height} pixels in {scans} scans: more than is unpacked")]
    TooLarge {
        /// In pixels.
        width: usize,
        /// In pixels.
        height: usize,
        /// How often the pixels are gone through.
        scans: usize,
    },
    /// The decoder's own sentence.
    #[error("its JPEG is damaged: {0}")]
    Damaged(String),
}
