// Writes and reads MCAP with npm's library, as tests/languages.rs asks.
//
// node by_javascript.cjs MODULES write PLAN FOLDER: forms of the plan as FOLDER/javascript-NUMBER.mcap
// node by_javascript.cjs MODULES read FOLDER OUT: what every file of the folder holds, as JSON
"use strict";

const fs = require("node:fs");
const path = require("node:path");
const zlib = require("node:zlib");
const { createRequire } = require("node:module");

const [modules, verb, first, second] = process.argv.slice(2);
const load = createRequire(path.join(modules, "package.json"));
const { McapIndexedReader, McapStreamReader, McapWriter } = load("@mcap/core");
const lz4 = load("@foxglove/wasm-lz4");

const hex = (bytes) => Buffer.from(bytes).toString("hex");
const bytes = (text) => Uint8Array.from(Buffer.from(text, "hex"));
const sorted = (map) => Object.fromEntries([...map].sort());

// The library leaves compressing to its caller, and no kept package of npm makes frames of LZ4:
// this one holds its block as it is.
function lz4Frame(data) {
  const head = Buffer.from("04224d18604082", "hex");
  const size = Buffer.alloc(4);
  size.writeUInt32LE((data.length | 0x80000000) >>> 0);
  return Buffer.concat([head, size, data, Buffer.alloc(4)]);
}

const COMPRESS = {
  none: undefined,
  lz4: (data) => ({ compression: "lz4", compressedData: lz4Frame(data) }),
  zstd: (data) => ({ compression: "zstd", compressedData: zlib.zstdCompressSync(data) }),
};
const DECOMPRESS = {
  lz4: (data, size) => lz4(data, Number(size)),
  zstd: (data) => zlib.zstdDecompressSync(data),
};

class Memory {
  pieces = [];
  length = 0;
  position() {
    return BigInt(this.length);
  }
  async write(buffer) {
    this.pieces.push(Buffer.from(buffer));
    this.length += buffer.length;
  }
}

async function write(file, form, content) {
  const writable = new Memory();
  const writer = new McapWriter({
    writable,
    chunkSize: form.chunk_size,
    compressChunk: COMPRESS[form.compression],
    useChunks: form.chunked,
    useStatistics: form.statistics,
    useSummaryOffsets: form.summary,
    repeatSchemas: form.repeat_schemas,
    repeatChannels: form.repeat_channels,
    useAttachmentIndex: form.summary,
    useMetadataIndex: form.summary,
    useMessageIndex: form.index,
    useChunkIndex: form.summary,
  });
  await writer.start({ profile: content.profile, library: "" });
  const schemas = [];
  for (const [name, encoding, data] of content.schemas) {
    schemas.push(await writer.registerSchema({ name, encoding, data: bytes(data) }));
  }
  const channels = [];
  for (const [topic, messageEncoding, schema, metadata] of content.channels) {
    const schemaId = schema === null ? 0 : schemas[schema];
    const about = { schemaId, topic, messageEncoding, metadata: new Map(Object.entries(metadata)) };
    channels.push(await writer.registerChannel(about));
  }
  for (const [number, [channel, log, publish, sequence, data]] of content.messages.entries()) {
    if (number === content.before_message) {
      await surround(writer, form, content);
    }
    await writer.addMessage({
      channelId: channels[channel],
      sequence,
      logTime: BigInt(log),
      publishTime: BigInt(publish),
      data: bytes(data),
    });
  }
  await writer.end();
  fs.writeFileSync(file, Buffer.concat(writable.pieces));
}

async function surround(writer, form, content) {
  for (const [log, create, name, mediaType, data] of form.attachments ? content.attachments : []) {
    const times = { logTime: BigInt(log), createTime: BigInt(create) };
    await writer.addAttachment({ ...times, name, mediaType, data: bytes(data) });
  }
  for (const [name, entries] of form.metadata ? content.metadata : []) {
    await writer.addMetadata({ name, metadata: new Map(Object.entries(entries)) });
  }
}

function message(schemas, channels, each) {
  const channel = channels.get(each.channelId);
  const schema = schemas.get(channel.schemaId);
  return [
    channel.topic,
    channel.messageEncoding,
    schema ? [schema.name, schema.encoding, hex(schema.data)] : null,
    sorted(channel.metadata),
    String(each.logTime),
    String(each.publishTime),
    each.sequence,
    hex(each.data),
  ];
}

function attachment(each) {
  const { logTime, createTime, name, mediaType, data } = each;
  return [String(logTime), String(createTime), name, mediaType, hex(data)];
}

function stream(data) {
  const reader = new McapStreamReader({ validateCrcs: true, decompressHandlers: DECOMPRESS });
  reader.append(data);
  const [schemas, channels] = [new Map(), new Map()];
  const found = { messages: [], attachments: [], metadata: [] };
  for (let each = reader.nextRecord(); each; each = reader.nextRecord()) {
    if (each.type === "Schema") schemas.set(each.id, each);
    if (each.type === "Channel") channels.set(each.id, each);
    if (each.type === "Message") found.messages.push(message(schemas, channels, each));
    if (each.type === "Attachment") found.attachments.push(attachment(each));
    if (each.type === "Metadata") found.metadata.push([each.name, sorted(each.metadata)]);
  }
  if (!reader.done()) throw new Error("the file does not end");
  return found;
}

// What the library reads by indexes; null where a file has none for it.
async function indexed(data) {
  const readable = {
    size: async () => BigInt(data.length),
    read: async (offset, size) => data.subarray(Number(offset), Number(offset + size)),
  };
  const options = { readable, decompressHandlers: DECOMPRESS };
  const reader = await McapIndexedReader.Initialize(options).catch((error) => String(error));
  if (typeof reader === "string" || reader.chunkIndexes.length === 0) return null;
  if (reader.chunkIndexes.some((each) => each.messageIndexOffsets.size === 0)) return null;
  if (reader.channelsById.size === 0 || reader.schemasById.size === 0) return null;
  const found = [];
  for await (const each of reader.readMessages({ validateCrcs: true })) {
    found.push(message(reader.schemasById, reader.channelsById, each));
  }
  return found;
}

async function main() {
  if (verb === "write") {
    const { forms, content } = JSON.parse(fs.readFileSync(first));
    for (const [number, form] of forms.entries()) {
      // The library writes checksums always.
      if (form.crc) {
        await write(path.join(second, `javascript-${number}.mcap`), form, content);
      }
    }
    return;
  }
  await lz4.isLoaded;
  const found = {};
  for (const name of fs.readdirSync(first).filter((each) => each.endsWith(".mcap"))) {
    const data = fs.readFileSync(path.join(first, name));
    try {
      found[path.parse(name).name] = { ...stream(data), by_index: await indexed(data) };
    } catch (error) {
      throw new Error(`${name}: ${error}`, { cause: error });
    }
  }
  fs.writeFileSync(second, JSON.stringify(found));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
