/* A DDS type whose samples are serialised messages as they are, whatever the message is. */
#pragma once
#include <dds/dds.h>
#include <stddef.h>
#include <stdint.h>

struct ddsi_serdata;
struct ddsi_sertype;

/* A topic of this type name, or a negative DDS error. `*type` is what samples are made with. */
dds_entity_t blob_topic(dds_entity_t participant, const char *name, const char *type_name,
                        const struct ddsi_sertype **type);

/* Writes a message, which is copied. */
dds_return_t blob_write(dds_entity_t writer, const struct ddsi_sertype *type, const uint8_t *bytes,
                        size_t length);

/* Takes the next message: 1, or 0 if there is none, or a negative DDS error. It is to be released. */
dds_return_t blob_take(dds_entity_t reader, dds_sample_info_t *info, struct ddsi_serdata **blob);
const uint8_t *blob_bytes(const struct ddsi_serdata *blob, size_t *length);
void blob_release(struct ddsi_serdata *blob);
