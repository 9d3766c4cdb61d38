/* Parses announcements: with GUIDs of both lengths in both byte orders, each prefix of them, and 200,000 of
 * them with some bytes changed. */
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
