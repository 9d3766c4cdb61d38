//! A camera's JPEG: any bytes give few pixels or a sentence, within memory that its bounds name.
#![no_main]

use bagpipe_fuzz::bounded;
use bagpipe_pictures::few_pixels;
use libfuzzer_sys::fuzz_target;

/// For the largest picture that is unpacked: `few_pixels` says so.
const MOST: usize = 160 << 20;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(made) = bounded(MOST + 16 * bytes.len(), || few_pixels(bytes, 320)) {
        assert!(made.rows <= 320 && made.columns <= 320);
        assert_eq!(made.data.len(), made.rows * made.columns * made.channels);
    }
});
