/* A DDS type whose samples are serialised messages as they are, whatever the message is. */
#pragma once
#include <dds/dds.h>
#include <stddef.h>
#include <stdint.h>

struct ddsi_serdata;

/* A topic of this type name; what is negative is a DDS error. `*type` is what samples are made with. */
dds_entity_t blob_topic(dds_entity_t participant, const char *name, const char *type_name,
                        const void **type);

/* Writes a message. */
dds_return_t blob_write(dds_entity_t writer, const void *type, const uint8_t *bytes, size_t length);

/* Takes the next message with its length, or NULL; it is to be released. */
struct ddsi_serdata *blob_take(dds_entity_t reader, dds_sample_info_t *info, const uint8_t **bytes,
                               size_t *length);
void blob_release(struct ddsi_serdata *blob);
