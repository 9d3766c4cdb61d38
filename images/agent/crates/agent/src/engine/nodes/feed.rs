//! Receiving a case's recording into memory; or into a file, which is measured beside it.

use std::io::Write;
use std::time::Instant;

use bagpipe_wire::{Duplex, End, FileHeader, FrameType, from_map};

use crate::case::failure::Failure;
use crate::engine::on_disk::{OnDisk, failed};
use crate::formats::{self, Opened, Refused};

/// Receives FILE, its DATA and END into memory, and opens the recording. Memory grows with what
/// really comes, and never past `budget`.
pub fn receive(
    link: &mut Duplex,
    budget: u64,
    deadline: Instant,
    stop: &dyn Fn() -> bool,
) -> Result<(FileHeader, Opened), Failure> {
    let header = receive_header(link, budget, deadline, stop)?;
    let mut bytes = Vec::new();
    receive_data(link, &header, &mut bytes, deadline, stop)?;
    let opened = whole(formats::stream(bytes, budget - header.size), &header)?;
    Ok((header, opened))
}

/// The same into a file.
pub fn receive_on_disk(
    link: &mut Duplex,
    budget: u64,
    (deadline, stop): (Instant, &dyn Fn() -> bool),
    disk: &OnDisk,
) -> Result<(FileHeader, Opened), Failure> {
    let header = receive_header(link, budget, deadline, stop)?;
    disk.write(|file| receive_data(link, &header, file, deadline, stop))?;
    let path = disk.input();
    disk.settle(&path)?;
    let stream = formats::stream_on_disk(&path, budget - header.size);
    let opened = whole(stream.map_err(|error| failed(&path, &error))?, &header)?;
    Ok((header, opened))
}

fn receive_header(
    link: &mut Duplex,
    budget: u64,
    deadline: Instant,
    stop: &dyn Fn() -> bool,
) -> Result<FileHeader, Failure> {
    let frame = link.receive(deadline, stop)?;
    let header: FileHeader = match frame.kind {
        FrameType::File => understood(&frame.payload, "FILE")?,
        FrameType::Abort => return Err(aborted()),
        kind => return Err(unexpected(kind, "FILE")),
    };
    if header.size > budget {
        return Err(Failure::new(
            "MemoryBudgetExceeded",
            format!(
                "{} sends {} bytes, and a case may take {budget}: cut shorter fragments, or \
                 give `bagpipe-agent serve` a larger --memory-budget",
                header.name, header.size
            ),
        ));
    }
    Ok(header)
}

fn whole(opened: Result<Opened, Refused>, header: &FileHeader) -> Result<Opened, Failure> {
    let opened = opened.map_err(|refused| unreadable(header, &refused))?;
    match &opened.loss {
        None => Ok(opened),
        Some(loss) => {
            let place = place(header, Some(loss.offset));
            let message =
                format!("{place}: expected {}; {} bytes are lost", loss.description, loss.bytes);
            Err(Failure::new("BagUnreadable", message))
        }
    }
}

fn receive_data(
    link: &mut Duplex,
    header: &FileHeader,
    into: &mut dyn Write,
    deadline: Instant,
    stop: &dyn Fn() -> bool,
) -> Result<(), Failure> {
    let mut length = 0;
    loop {
        let frame = link.receive(deadline, stop)?;
        match frame.kind {
            FrameType::Data => {
                let more = frame.payload.len() as u64;
                if more > header.size - length {
                    let message =
                        format!("{} sends more than its {} bytes", header.name, header.size);
                    return Err(Failure::protocol(message));
                }
                length += more;
                into.write_all(&frame.payload).map_err(|error| {
                    Failure::new("Internal", format!("the bag's file takes no more: {error}"))
                })?;
            }
            FrameType::End => {
                let claimed: End = understood(&frame.payload, "END")?;
                return check_end(link, header, length, claimed);
            }
            FrameType::Abort => return Err(aborted()),
            FrameType::File => {
                return Err(Failure::protocol("a case has one FILE, and a second one came"));
            }
            kind => return Err(unexpected(kind, "DATA or END")),
        }
    }
}

fn check_end(link: &Duplex, header: &FileHeader, length: u64, claimed: End) -> Result<(), Failure> {
    link.decoder().check_end(claimed).map_err(Failure::protocol)?;
    if length != header.size {
        let FileHeader { name, size, .. } = header;
        return Err(Failure::protocol(format!("{name} has {size} bytes, and {length} came")));
    }
    Ok(())
}

/// What is wrong with the recording, with the place in the user's own file.
fn unreadable(header: &FileHeader, refused: &Refused) -> Failure {
    let Refused { over_memory, offset, text } = refused;
    let place = place(header, *offset);
    let reason = if *over_memory { "MemoryBudgetExceeded" } else { "BagUnreadable" };
    // The place is the user's own; the error's is that of what was sent.
    let own = offset.map(|offset| format!("byte {offset}: ")).unwrap_or_default();
    Failure::new(reason, format!("{place}: {}", text.strip_prefix(&own).unwrap_or(text)))
}

fn place(header: &FileHeader, offset: Option<u64>) -> String {
    let FileHeader { name, ranges, .. } = header;
    match offset.map(|offset| (offset, header.source_offset(offset))) {
        None => name.clone(),
        Some((_, Some(source))) => format!("{name} at byte {source}"),
        Some((offset, None)) if ranges.is_empty() => format!("{name} at byte {offset}"),
        Some((offset, None)) => format!("{name} at byte {offset} of what was sent of it"),
    }
}

fn understood<T: serde::de::DeserializeOwned>(payload: &[u8], kind: &str) -> Result<T, Failure> {
    from_map(payload)
        .map_err(|error| Failure::protocol(format!("{kind} cannot be understood: {error}")))
}

fn unexpected(kind: FrameType, expected: &str) -> Failure {
    Failure::protocol(format!("expected {expected}, and {} came", kind.name()))
}

fn aborted() -> Failure {
    Failure::Silent("the worker aborted the case".to_owned())
}
