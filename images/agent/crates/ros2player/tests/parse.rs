//! What others announce of their nodes is parsed without a step beyond its end, whatever it is.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::Command;

/// Reads what a program of C has made of announcements: with GUIDs of both lengths in both byte
/// orders, of each prefix of them, and of 200,000 of them with some bytes changed.
const HARNESS: &str = r#"
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "nodes.h"

static uint8_t message[4096];
static size_t length, nodes, known;
static uint64_t state = 88172645463325252ull;

static uint64_t chance(void) {
  state ^= state << 13, state ^= state >> 7, state ^= state << 17;
  return state;
}
static void put(const void *bytes, size_t some) {
  memcpy(message + length, bytes, some);
  length += some;
}
static void number(uint32_t value, int little) {
  while (length % 4 != 0) put("", 1);
  for (int byte = 0; byte < 4; byte++) {
    uint8_t one = (uint8_t)(value >> 8 * (little ? byte : 3 - byte));
    put(&one, 1);
  }
}
static void text(const char *value, int little) {
  number((uint32_t)strlen(value) + 1, little);
  put(value, strlen(value) + 1);
}
static void guid(uint8_t fill, size_t size) {
  uint8_t bytes[24] = {0};
  memset(bytes, fill, 16);
  put(bytes, size);
}
static void announce(int little, size_t size) {
  length = 0;
  put((uint8_t[]){0, (uint8_t)little, 0, 0}, 4);
  guid(1, size);
  number(2, little);
  for (uint8_t one = 0; one < 2; one++) {
    text(one ? "/ns" : "/", little);
    text("relay", little);
    number(one, little);
    for (uint8_t at = 0; at < one; at++) guid(7, size);
    number(2, little);
    guid(8, size), guid(9, size);
  }
}
static void visit(const struct announced_node *node, void *wanted) {
  nodes++;
  known += guids_have(&node->writers, wanted) + strlen(node->space) + strlen(node->name);
}
static int parse(size_t some) {
  uint8_t *copy = malloc(some);  /* so that a step beyond it is seen */
  memcpy(copy, message, some);
  dds_guid_t whose, wanted;
  memset(wanted.v, 9, sizeof wanted.v);
  nodes = known = 0;
  int is = nodes_parse(copy, some, &whose, visit, &wanted);
  free(copy);
  return is && whose.v[15] == message[19];
}
int main(void) {
  size_t parsed = 0, refused = 0, prefixes = 0;
  for (int kind = 0; kind < 4; kind++) {
    announce(kind & 1, kind & 2 ? 24 : 16);
    if (!parse(length) || nodes != 2 || known != 2 + 1 + 3 + 2 * 5) return 1;
    for (size_t some = 0; some < length; some++) prefixes += parse(some) ? 1 : 0;
    /* A name without an end. */
    *((uint8_t *)memmem(message, length, "relay", 6) + 5) = 'x';
    if (parse(length)) return 2;
  }
  for (int round = 0; round < 200000; round++) {
    announce(round & 1, round & 2 ? 24 : 16);
    for (uint64_t some = chance() % 4; some <= 4; some++)
      message[chance() % length] = chance() % 3 ? (uint8_t)chance() : 0xff;
    parse(length - chance() % 5 / 4) ? parsed++ : refused++;
  }
  printf("%zu %zu %zu\n", prefixes, parsed, refused);
  return 0;
}
"#;

#[test]
fn announcements_are_parsed_or_refused_within_their_bytes() {
    let folder = std::env::temp_dir().join(format!("ros2-parse-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (source, program) = (folder.join("harness.c"), folder.join("harness"));
    std::fs::write(&source, HARNESS).unwrap();
    let player = Path::new(env!("CARGO_MANIFEST_DIR")).join("player/dds");
    let compiled = Command::new("cc")
        .args(["-std=gnu11", "-O1", "-g", "-fsanitize=address,undefined"])
        .args(["-fno-sanitize-recover=all", "-I"])
        .args([&player, &player.join("parse.c"), &source, Path::new("-o"), &program])
        .output()
        .unwrap();
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let output = Command::new(&program).output().unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let numbers: Vec<u64> = text.split_whitespace().map(|number| number.parse().unwrap()).collect();
    // A prefix of a long GUID and its zeros is a short one with no nodes: with none to three bytes
    // behind it, in both orders. No other is whole.
    assert_eq!(numbers[0], 8);
    // Of those with changed bytes some differ in a name or a GUID alone.
    assert!(numbers[1] > 10_000 && numbers[2] > 10_000, "{text}");
}
