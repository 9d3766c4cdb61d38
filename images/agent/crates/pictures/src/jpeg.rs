//! JPEG unpacked and made smaller by leaving pixels out.

use std::panic::{AssertUnwindSafe, catch_unwind};

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::error::PictureError;
use crate::head::{Head, head};

/// Pixels of a picture that is unpacked: 4,096 by 4,096, which take 48 MiB for a moment.
const MOST_PIXELS: usize = 1 << 24;
/// Of a progressive one, whose coefficients are held as well: 3,840 by 2,160.
const MOST_PROGRESSIVE: usize = 1 << 23;
/// Pixels times scans: thirty scans of the largest progressive picture.
const MOST_WORK: usize = 30 * MOST_PROGRESSIVE;

/// Few pixels of a picture, row by row.
#[derive(Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Of the picture itself, in pixels.
    pub width: usize,
    /// Of the picture itself, in pixels.
    pub height: usize,
    /// How many rows are here.
    pub rows: usize,
    /// How many pixels each of them has.
    pub columns: usize,
    /// Bytes of a pixel: 1 for grey, 3 for red, green and blue.
    pub channels: usize,
    /// `rows` times `columns` times `channels` bytes.
    pub data: Vec<u8>,
}

/// Unpack a JPEG, and keep at most `side` rows and columns of it, evenly, in its proportions.
///
/// A picture that is cut off has its missing rows in one colour. Its orientation (EXIF) is left as
/// the camera took it. Memory is at most some 150 MiB, for the largest picture that is unpacked.
///
/// # Errors
/// For all that is no such picture, that is too large by its head, and where the decoder fails.
pub fn few_pixels(data: &[u8], side: usize) -> Result<Pixels, PictureError> {
    let found = head(data)?;
    within(&found)?;
    // It is pure and its bytes are anybody's: a fault of the decoder's ends here.
    match catch_unwind(AssertUnwindSafe(|| unpacked(data, &found))) {
        Ok(result) => result.and_then(|(space, bytes)| fewer(&found, side, space, &bytes)),
        Err(_) => Err(PictureError::Damaged("the decoder gave up".to_owned())),
    }
}

fn within(found: &Head) -> Result<(), PictureError> {
    let pixels = found.width * found.height;
    let most = if found.progressive { MOST_PROGRESSIVE } else { MOST_PIXELS };
    if pixels == 0 {
        return Err(PictureError::Unknown("it has no pixels"));
    }
    if pixels > most || pixels * found.scans > MOST_WORK.max(most) {
        let Head { width, height, scans, .. } = *found;
        return Err(PictureError::TooLarge { width, height, scans });
    }
    Ok(())
}

fn unpacked(data: &[u8], found: &Head) -> Result<(usize, Vec<u8>), PictureError> {
    let damaged = |error: &dyn std::fmt::Display| PictureError::Damaged(error.to_string());
    // Should the decoder find another head than ours, it may not go by a larger one.
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(found.width)
        .set_max_height(found.height);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(data), options);
    decoder.decode_headers().map_err(|error| damaged(&error))?;
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let space = if grey { ColorSpace::Luma } else { ColorSpace::RGB };
    decoder.set_options(options.jpeg_set_out_colorspace(space));
    let bytes = decoder.decode().map_err(|error| damaged(&error))?;
    Ok((if grey { 1 } else { 3 }, bytes))
}

fn fewer(found: &Head, side: usize, channels: usize, bytes: &[u8]) -> Result<Pixels, PictureError> {
    let Head { width, height, .. } = *found;
    if bytes.len() != width * height * channels {
        return Err(PictureError::Damaged("it is of another size than it says".to_owned()));
    }
    let longest = width.max(height).max(side);
    let rows = (height * side / longest).max(1);
    let columns = (width * side / longest).max(1);
    let mut data = Vec::with_capacity(rows * columns * channels);
    for row in 0..rows {
        let begin = row * height / rows * width;
        for column in 0..columns {
            let at = (begin + column * width / columns) * channels;
            data.extend_from_slice(&bytes[at..at + channels]);
        }
    }
    Ok(Pixels { width, height, rows, columns, channels, data })
}
