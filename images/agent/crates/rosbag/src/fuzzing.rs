//! The decompressors alone, for the fuzz targets and the damage run only (feature `fuzzing`).

use bagpipe_packing::Packing;

use crate::Compression;

/// A chunk's data of `size` bytes: what came out, and what was wrong.
pub fn unpack(compression: Compression, data: &[u8], size: u32) -> (Vec<u8>, Option<String>) {
    compression.decompress(data, size)
}

/// A chunk's data as it is written.
pub fn pack(compression: Compression, data: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    compression.compress(data, &mut out)?;
    Ok(out)
}
