//! Whether a recording is what it says that it is.

use std::collections::BTreeMap;

use bagpipe_log::{Checked, Reason, Refusal, Span, mixed_types, packed};

use crate::part::Part;
use crate::{Limits, MAGIC, Mcap, McapError, tail};

/// Reads every record of the recording, uncompresses every chunk, and compares what it finds
/// with the summary and its indexes, which it need not have.
///
/// # Errors
/// As [`Mcap::open_scanned`].
pub fn check(file: Vec<u8>, limits: Limits) -> Result<Checked, McapError> {
    let recording = Mcap::open_scanned(file, limits)?;
    let mut problems = Vec::new();
    match summary(&recording.file) {
        Ok(spans) => compare(&spans, &recording.parts, &mut problems),
        Err(Refusal { reason: Reason::Unreadable, sentence }) => problems.push(sentence),
        // What is cut was found to be, and neither a message nor an index is demanded.
        Err(_) => {}
    }
    problems.extend(mixed_types(recording.connections()));
    problems.extend(recording.packed_topic().map(packed));
    let messages = recording.message_count();
    Ok(Checked { messages, loss: recording.loss().cloned(), problems })
}

/// The chunks with messages, as the summary has them.
fn summary(file: &[u8]) -> Result<Vec<Span>, Refusal> {
    let head_end = tail::parse_head(file)?;
    let size = file.len() as u64;
    let footer = &file[file.len().saturating_sub(tail::FOOTER_BYTES as usize)..];
    let (begin, end) = tail::parse_footer(footer, size)?;
    let index = tail::parse_summary(&file[begin as usize..end as usize], begin, head_end, footer)?;
    Ok(index.chunks)
}

fn compare(spans: &[Span], parts: &[Part], problems: &mut Vec<String>) {
    let of_chunks = |part: &&Part| part.is_chunk() && part.messages() > 0;
    let found: BTreeMap<u64, &Part> =
        parts.iter().filter(of_chunks).map(|part| (part.position as u64, part)).collect();
    if spans.len() != found.len() {
        let (listed, found) = (spans.len(), found.len());
        problems.push(format!("the summary knows {listed} chunks, and the file holds {found}"));
    }
    for span in spans {
        let at = span.offset;
        let Some(made) = found.get(&at).and_then(|part| part.made.get()) else {
            problems.push(format!("the summary names a chunk at byte {at}, where none is"));
            continue;
        };
        let walked = &made.walked;
        let mut counts: Vec<(u32, u32)> =
            walked.counts.iter().map(|each| (u32::from(each.channel), each.messages)).collect();
        counts.sort_unstable();
        let listed: Vec<_> = span.counts.iter().copied().filter(|(_, count)| *count > 0).collect();
        if listed != counts {
            let (listed, found) = (total(&listed), total(&counts));
            problems.push(format!(
                "the summary counts {listed} messages in the chunk at byte {at}, which holds {found}"
            ));
        } else if (span.start_time, span.end_time) != walked.times {
            problems.push(format!("the summary has wrong times for the chunk at byte {at}"));
        }
    }
}

fn total(counts: &[(u32, u32)]) -> u64 {
    counts.iter().map(|(_, count)| u64::from(*count)).sum()
}

/// Whether bytes begin as MCAP does.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}
