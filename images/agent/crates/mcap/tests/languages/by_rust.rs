//! The crate `mcap`, and ours.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::Cursor;

use bagpipe_mcap::{
    Attachment, Channel, Compression, Mcap, McapWriter, Metadata, Schema, Stamp, WriterOptions,
};
use mcap::records::Record;
use serde_json::{Value, json};

use crate::content::{self, BEFORE, Form, MESSAGES, PROFILE, attachment, hex};

/// A file by the crate `mcap`.
pub fn theirs(form: &Form) -> Vec<u8> {
    let compression = match form.compression {
        "lz4" => Some(mcap::Compression::Lz4),
        "zstd" => Some(mcap::Compression::Zstd),
        _ => None,
    };
    let options = mcap::WriteOptions::new()
        .compression(compression)
        .profile(PROFILE)
        .chunk_size(Some(form.chunk_size as u64))
        .use_chunks(form.chunked)
        .emit_summary_offsets(form.summary)
        .emit_statistics(form.statistics)
        .emit_message_indexes(form.index)
        .emit_chunk_indexes(form.summary)
        .emit_attachment_indexes(form.summary)
        .emit_metadata_indexes(form.summary)
        .repeat_channels(form.repeat_channels)
        .repeat_schemas(form.repeat_schemas)
        .calculate_chunk_crcs(form.crc)
        .calculate_data_section_crc(form.crc)
        .calculate_summary_section_crc(form.crc)
        .calculate_attachment_crcs(form.crc);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schemas = content::schemas()
        .map(|(name, encoding, data)| writer.add_schema(name, encoding, data).unwrap());
    let channels = content::channels().map(|(topic, encoding, schema, words)| {
        let schema = schema.map_or(0, |at| schemas[at]);
        writer.add_channel(schema, topic, encoding, &words).unwrap()
    });
    for number in 0..MESSAGES {
        if number == BEFORE {
            their_surroundings(&mut writer, form);
        }
        let (channel, log_time, publish_time, sequence, data) = content::message(number);
        let channel_id = channels[channel];
        let head = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
        writer.write_to_known_channel(&head, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn their_surroundings(writer: &mut mcap::Writer<Cursor<Vec<u8>>>, form: &Form) {
    for (log_time, create_time, name, media_type, data) in content::attachments() {
        let (name, media_type) = (name.to_owned(), media_type.to_owned());
        let data = Cow::Borrowed(data);
        let file = mcap::Attachment { log_time, create_time, name, media_type, data };
        if form.attachments {
            writer.attach(&file).unwrap();
        }
    }
    let (name, metadata) = content::metadata();
    if form.metadata {
        writer
            .write_metadata(&mcap::records::Metadata { name: name.to_owned(), metadata })
            .unwrap();
    }
}

/// A file by our own writer.
pub fn ours(form: &Form) -> Vec<u8> {
    let compression = match form.compression {
        "lz4" => Compression::Lz4,
        "zstd" => Compression::Zstd,
        _ => Compression::None,
    };
    let (profile, chunk_threshold) = (PROFILE.to_owned(), form.chunk_size);
    let options = WriterOptions { compression, chunk_threshold, profile, byte_budget: None };
    let mut writer = McapWriter::new(options);
    let schemas = content::schemas().map(|(name, encoding, data)| Schema {
        id: 0,
        name: name.to_owned(),
        encoding: encoding.to_owned(),
        data: data.to_vec(),
    });
    let channels = content::channels().map(|(topic, encoding, schema, metadata)| {
        let (topic, message_encoding) = (topic.to_owned(), encoding.to_owned());
        let channel = Channel { topic, message_encoding, metadata, ..Channel::default() };
        writer.add_channel(schema.map(|at| &schemas[at]), &channel)
    });
    for number in 0..MESSAGES {
        if number == BEFORE {
            our_surroundings(&mut writer, form);
        }
        let (channel, time, publish_time, sequence, data) = content::message(number);
        let stamp = Stamp { sequence, publish_time };
        writer.write_stamped(channels[channel], time, stamp, &data).unwrap();
    }
    writer.finish().unwrap()
}

fn our_surroundings(writer: &mut McapWriter, form: &Form) {
    for (log_time, create_time, name, media_type, data) in content::attachments() {
        if form.attachments {
            writer.attach(&Attachment { log_time, create_time, name, media_type, data }).unwrap();
        }
    }
    let (name, entries) = content::metadata();
    if form.metadata {
        writer.describe(&Metadata { name: name.to_owned(), entries }).unwrap();
    }
}

/// What the crate `mcap` finds from the front.
pub fn read_by_theirs(bytes: &[u8]) -> Value {
    let mut schemas = HashMap::new();
    let mut channels = HashMap::new();
    let (mut messages, mut attachments, mut metadata) = (Vec::new(), Vec::new(), Vec::new());
    for record in mcap::read::ChunkFlattener::new(bytes).unwrap() {
        match record.unwrap() {
            Record::Schema { header, data } => {
                let kind = json!([header.name, header.encoding, hex(&data)]);
                schemas.insert(header.id, kind);
            }
            Record::Channel(channel) => _ = channels.insert(channel.id, channel),
            Record::Message { header, data } => {
                let channel = &channels[&header.channel_id];
                let (log, publish) = (header.log_time.to_string(), header.publish_time.to_string());
                messages.push(json!([
                    channel.topic,
                    channel.message_encoding,
                    schemas.get(&channel.schema_id),
                    channel.metadata,
                    log,
                    publish,
                    header.sequence,
                    hex(&data)
                ]));
            }
            Record::Attachment { header, data, .. } => attachments.push(attachment((
                header.log_time,
                header.create_time,
                &header.name,
                &header.media_type,
                &data,
            ))),
            Record::Metadata(words) => metadata.push(json!([words.name, words.metadata])),
            _ => {}
        }
    }
    json!({"messages": messages, "attachments": attachments, "metadata": metadata})
}

/// What we find.
pub fn read_by_ours(bytes: Vec<u8>) -> Value {
    let file = Mcap::open(bytes).unwrap();
    assert_eq!(file.loss(), None);
    assert_eq!(file.profile(), PROFILE);
    let schemas: BTreeMap<u16, Value> = file
        .schemas()
        .iter()
        .map(|each| (each.id, json!([each.name, each.encoding, hex(&each.data)])))
        .collect();
    let channels: BTreeMap<u32, &Channel> =
        file.channels().iter().map(|each| (u32::from(each.id), each)).collect();
    let (chunks, places) = file.timeline(|_| true).unwrap().into_parts();
    let messages = places.iter().map(|place| {
        let channel = channels[&place.connection];
        let stamp = file.stamp(place).unwrap();
        let data = &chunks[place.chunk as usize][place.start as usize + 4..place.end as usize];
        json!([
            channel.topic,
            channel.message_encoding,
            schemas.get(&channel.schema_id),
            channel.metadata,
            place.time.to_string(),
            stamp.publish_time.to_string(),
            stamp.sequence,
            hex(data)
        ])
    });
    let attachments = file.attachments().map(|each| {
        let Attachment { log_time, create_time, name, media_type, data } = each;
        attachment((log_time, create_time, name, media_type, data))
    });
    let metadata = file.metadata().iter().map(|words| json!([words.name, words.entries]));
    json!({
        "messages": messages.collect::<Vec<_>>(),
        "attachments": attachments.collect::<Vec<_>>(),
        "metadata": metadata.collect::<Vec<_>>(),
    })
}
