//! What a JPEG's markers say of its size and its work, without unpacking it (ITU-T T.81, annex B).

use crate::error::PictureError;

const START: [u8; 2] = [0xFF, 0xD8];
const SCAN: u8 = 0xDA;
const END: u8 = 0xD9;
/// Markers without a length: of one byte of no meaning, and restarts within a scan.
const BARE: std::ops::RangeInclusive<u8> = 0xD0..=0xD7;
/// Frames that are unpacked: baseline, extended and progressive, by Huffman codes.
const FRAMES: [u8; 3] = [0xC0, 0xC1, 0xC2];
const PROGRESSIVE: u8 = 0xC2;
/// All kinds of frames, apart from tables (`DHT`, `DAC`) and `JPG` in the same range.
const ALL_FRAMES: std::ops::RangeInclusive<u8> = 0xC0..=0xCF;
const NO_FRAMES: [u8; 3] = [0xC4, 0xC8, 0xCC];

/// A picture of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    pub width: usize,
    pub height: usize,
    pub progressive: bool,
    /// How often its pixels are gone through.
    pub scans: usize,
}

/// Walk over all markers. Errors where there is not one frame of 8 bits and of one or three
/// colours before the first scan.
pub fn head(data: &[u8]) -> Result<Head, PictureError> {
    if !data.starts_with(&START) {
        return Err(PictureError::NotJpeg);
    }
    let (mut at, mut frame, mut scans) = (START.len(), None, 0);
    while let Some((marker, next)) = marker(data, at) {
        at = next;
        match marker {
            END => break,
            _ if BARE.contains(&marker) => {}
            SCAN => scans += 1,
            _ => {
                if ALL_FRAMES.contains(&marker) && !NO_FRAMES.contains(&marker) {
                    if frame.is_some() || scans > 0 {
                        return Err(PictureError::Unknown("it has several frames"));
                    }
                    frame = Some(of_frame(marker, data.get(at..).unwrap_or_default())?);
                }
                at += length(data, at).ok_or(PictureError::Unknown("its head is cut off"))?;
            }
        }
    }
    match frame {
        Some(found) if scans > 0 => Ok(Head { scans, ..found }),
        _ => Err(PictureError::Unknown("it has no frame, or no scan")),
    }
}

/// The next marker at or behind a place, and where it ends. Bytes of a scan lie between.
fn marker(data: &[u8], from: usize) -> Option<(u8, usize)> {
    let rest = data.get(from..)?;
    let pair = |two: &[u8]| two[0] == 0xFF && two[1] != 0 && two[1] != 0xFF;
    let place = rest.windows(2).position(pair)?;
    Some((rest[place + 1], from + place + 2))
}

/// Bytes of a marker's segment, its length's own two among them.
fn length(data: &[u8], at: usize) -> Option<usize> {
    let bytes = data.get(at..at + 2)?;
    let length = usize::from(u16::from_be_bytes([bytes[0], bytes[1]]));
    (length >= 2).then_some(length)
}

fn of_frame(marker: u8, segment: &[u8]) -> Result<Head, PictureError> {
    let &[_, _, bits, h1, h0, w1, w0, colours, ..] = segment else {
        return Err(PictureError::Unknown("its head is cut off"));
    };
    if !FRAMES.contains(&marker) {
        return Err(PictureError::Unknown("it is lossless or has arithmetic codes"));
    }
    if bits != 8 || !matches!(colours, 1 | 3) {
        return Err(PictureError::Unknown("it is not of 8 bits, in grey or in three colours"));
    }
    Ok(Head {
        width: usize::from(u16::from_be_bytes([w1, w0])),
        height: usize::from(u16::from_be_bytes([h1, h0])),
        progressive: marker == PROGRESSIVE,
        scans: 0,
    })
}
