/* Parses CDR of rmw_dds_common/msg/ParticipantEntitiesInfo: a GUID, and nodes with their namespace,
 * their name, and the GUIDs of their readers and writers. */
#include <string.h>

#include "nodes.h"

#define HEAD 4 /* how it is encoded */
#define GUID 16

struct cursor {
  const uint8_t *bytes;
  size_t length, at;
  bool swapped, wrong;
};

static const uint8_t *some(struct cursor *from, size_t length) {
  if (from->wrong || length > from->length - from->at) {
    from->wrong = true;
    return NULL;
  }
  const uint8_t *found = from->bytes + from->at;
  from->at += length;
  return found;
}

static uint32_t number(struct cursor *from) {
  uint32_t found = 0;
  some(from, -(from->at - HEAD) & 3u); /* alignment */
  const uint8_t *bytes = some(from, sizeof found);
  if (bytes == NULL) return 0;
  memcpy(&found, bytes, sizeof found);
  return from->swapped ? __builtin_bswap32(found) : found;
}

static const char *text(struct cursor *from) {
  uint32_t length = number(from); /* with its 0 */
  const uint8_t *found = some(from, length);
  if (found == NULL || length == 0 || found[length - 1] != 0) {
    from->wrong = true;
    return "";
  }
  return (const char *)found;
}

static struct guids guids(struct cursor *from, size_t size) {
  struct guids found = {NULL, number(from), size};
  found.bytes = some(from, found.count * size);
  return found;
}

/* GUIDs of this size; false if it is not exactly that. */
static bool parse(struct cursor from, size_t size, dds_guid_t *participant, visit_node *visitor,
                  void *state) {
  const uint8_t *whose = some(&from, size);
  if (whose != NULL) memcpy(participant->v, whose, GUID);
  uint32_t nodes = number(&from);
  for (uint32_t one = 0; one < nodes && !from.wrong; one++) {
    struct announced_node node = {.space = text(&from), .name = text(&from)};
    node.readers = guids(&from, size);
    node.writers = guids(&from, size);
    if (!from.wrong && visitor != NULL) visitor(&node, state);
  }
  /* DDS sends whole groups of 4 bytes. */
  return !from.wrong && from.length - from.at < 4;
}

bool nodes_parse(const uint8_t *bytes, size_t length, dds_guid_t *participant, visit_node *visitor,
                 void *state) {
  if (length < HEAD || bytes[0] != 0 || bytes[1] > 1) return false;
  bool little = bytes[1] == 1;
  bool swapped = little != (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__);
  struct cursor from = {bytes, length, HEAD, swapped, false};
  /* Since Iron, and before. */
  size_t size = parse(from, GUID, participant, NULL, NULL)  ? GUID
                : parse(from, 24, participant, NULL, NULL) ? 24
                                                           : 0;
  return size != 0 && parse(from, size, participant, visitor, state);
}

bool guids_have(const struct guids *of, const dds_guid_t *wanted) {
  for (size_t one = 0; one < of->count; one++)
    if (memcmp(of->bytes + one * of->size, wanted->v, GUID) == 0) return true;
  return false;
}
