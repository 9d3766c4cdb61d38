//! Ours and the crate `mcap` read what either wrote, message by message, in every form.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use std::collections::BTreeMap;
use std::io::Read;

use bagpipe_mcap::{Compression, Mcap, WriterOptions, rewrite};
use sample::{ALL, ATTACHMENT, Plain, forms, messages, metadata, read, sample, theirs};

/// By the crate `mcap`, from front to back, by time.
fn by_stream(bytes: &[u8]) -> Vec<Plain> {
    let plain = |message: mcap::Message<'_>| {
        let topic = message.channel.topic.clone();
        let (time, publish) = (message.log_time, message.publish_time);
        (topic, time, publish, message.sequence, message.data.to_vec())
    };
    let mut all: Vec<Plain> =
        mcap::MessageStream::new(bytes).unwrap().map(|each| plain(each.unwrap())).collect();
    all.sort_by_key(|(_, time, ..)| *time);
    all
}

#[test]
fn what_the_crate_writes_in_every_form_is_read_message_by_message() {
    assert_eq!(forms().len(), 8 + 2 * 8 + 8);
    for form in forms() {
        let bytes = theirs(form);
        let recording = Mcap::open(bytes).unwrap();
        assert_eq!(recording.loss(), None, "{form:?}");
        assert_eq!(recording.profile(), "ros2");
        assert_eq!(recording.message_count(), 100, "{form:?}");
        let mut passed = Vec::new();
        recording.pass(|_| true, |each| passed.push((each.time, each.frame.to_vec()))).unwrap();
        assert!(read(&recording) == messages(), "{form:?}");
        let in_file = (0..100).map(sample::message).map(|(_, time, .., data)| {
            (time, [&(data.len() as u32).to_le_bytes()[..], &data].concat())
        });
        assert!(in_file.eq(passed), "{form:?}");
        let expected = ["/a", "/b"].map(sample::connection);
        let found = recording.connections().iter().cloned();
        let found: Vec<_> = found.map(|each| bagpipe_mcap::Connection { id: 0, ..each }).collect();
        assert_eq!(found, expected, "{form:?}");
        assert_eq!(recording.attachments().collect::<Vec<_>>(), [ATTACHMENT], "{form:?}");
        assert_eq!(recording.metadata(), [metadata()], "{form:?}");
        let all = messages();
        let times = (all[0].1, all.last().unwrap().1);
        assert_eq!(recording.time_range(), Some(times), "{form:?}");
    }
}

#[test]
fn what_we_write_is_read_by_the_crate_from_the_front_and_by_the_index() {
    for compression in ALL {
        let bytes = sample(compression);
        assert!(by_stream(&bytes) == messages(), "{compression:?}");
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let statistics = summary.stats.as_ref().unwrap();
        assert_eq!((statistics.message_count, statistics.channel_count), (100, 2));
        assert_eq!((statistics.schema_count, statistics.attachment_count), (1, 1));
        assert_eq!(statistics.metadata_count, 1);
        assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
        assert!(summary.chunk_indexes.len() > 5);
        let all = messages();
        assert_eq!(statistics.message_start_time, all[0].1);
        assert_eq!(statistics.message_end_time, all[99].1);
        let mut found = 0;
        for chunk in &summary.chunk_indexes {
            for (channel, entries) in summary.read_message_indexes(&bytes, chunk).unwrap() {
                for entry in entries {
                    let message = summary.seek_message(&bytes, chunk, &entry).unwrap();
                    assert_eq!(message.channel.id, channel.id);
                    assert_eq!(message.log_time, entry.log_time);
                    found += 1;
                }
            }
        }
        assert_eq!(found, 100);
        let index = &summary.attachment_indexes[0];
        let attachment = mcap::read::attachment(&bytes, index).unwrap();
        assert_eq!((&attachment.name[..], &attachment.data[..]), ("camera.yaml", ATTACHMENT.data));
        let index = &summary.metadata_indexes[0];
        assert_eq!(mcap::read::metadata(&bytes, index).unwrap().metadata, metadata().entries);
    }
}

#[test]
fn the_crate_finds_every_checksum_that_we_write() {
    for compression in ALL {
        let bytes = sample(compression);
        let mut reader = mcap::sans_io::linear_reader::LinearReader::new_with_options(
            mcap::sans_io::linear_reader::LinearReaderOptions::default()
                .with_validate_chunk_crcs(true)
                .with_validate_data_section_crc(true)
                .with_validate_summary_section_crc(true),
        );
        let (mut input, mut records) = (&bytes[..], 0);
        while let Some(event) = reader.next_event() {
            match event.unwrap() {
                mcap::sans_io::linear_reader::LinearReadEvent::ReadRequest(length) => {
                    let read = input.read(reader.insert(length)).unwrap();
                    reader.notify_read(read);
                }
                mcap::sans_io::linear_reader::LinearReadEvent::Record { .. } => records += 1,
            }
        }
        assert!(records > 100, "{records}");
        // Which are there.
        let data_end = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]);
        assert_ne!(bytes[data_end.unwrap() + 9..][..4], [0; 4]);
        assert_ne!(bytes[bytes.len() - 12..][..4], [0; 4]);
    }
}

#[test]
fn a_rewrite_keeps_all_that_the_seam_has_no_place_for() {
    for from in forms() {
        let recording = Mcap::open(theirs(from)).unwrap();
        let profile = recording.profile().to_owned();
        let options =
            WriterOptions { profile, ..WriterOptions::with_compression(Compression::Zstd) };
        let bytes = rewrite(&recording, options).unwrap();
        let again = Mcap::open(bytes).unwrap();
        assert_eq!(again.loss(), None);
        assert!(read(&again) == messages(), "{from:?}");
        assert_eq!(again.attachments().collect::<Vec<_>>(), [ATTACHMENT]);
        assert_eq!(again.metadata(), [metadata()]);
        let without_numbers = |recording: &Mcap| {
            let channels = recording.channels().iter().cloned();
            channels.map(|each| (each.topic, each.metadata)).collect::<BTreeMap<_, _>>()
        };
        assert_eq!(without_numbers(&again), without_numbers(&recording));
        assert_eq!(again.schemas()[0].data, b"string data\n");
    }
}
