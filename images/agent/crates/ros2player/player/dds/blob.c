#define _GNU_SOURCE
#include "blob.h"

#include <dds/ddsi/ddsi_radmin.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GROUP 4 /* bytes: DDS sends whole groups */

struct blob {
  struct ddsi_serdata head;
  uint32_t length;
  uint8_t bytes[]; /* and zeros up to a whole group */
};

/* NULL where there is no memory: DDS then refuses the message. */
static struct blob *blob_new(const struct ddsi_sertype *type, enum ddsi_serdata_kind kind,
                             size_t length) {
  struct blob *made = length > UINT32_MAX - GROUP ? NULL : malloc(sizeof *made + length + GROUP);
  if (made == NULL) return NULL;
  ddsi_serdata_init(&made->head, type, kind);
  made->length = (uint32_t)length;
  memset(made->bytes + length, 0, GROUP);
  return made;
}

static struct ddsi_serdata *head_of(struct blob *blob) { return blob == NULL ? NULL : &blob->head; }

static const struct blob *blob_of(const struct ddsi_serdata *head) {
  return (const struct blob *)head;
}

static struct ddsi_serdata *from_fragments(const struct ddsi_sertype *type,
                                           enum ddsi_serdata_kind kind,
                                           const struct ddsi_rdata *fragment, size_t length) {
  struct blob *made = blob_new(type, kind, length);
  uint32_t have = 0; /* fragments come in their order, and may overlap */
  for (; made != NULL && fragment != NULL; fragment = fragment->nextfrag) {
    if (fragment->maxp1 <= have) continue;
    if (fragment->min > have || fragment->maxp1 > length) break;
    const uint8_t *payload =
        DDSI_RMSG_PAYLOADOFF(fragment->rmsg, DDSI_RDATA_PAYLOAD_OFF(fragment));
    memcpy(made->bytes + have, payload + (have - fragment->min), fragment->maxp1 - have);
    have = fragment->maxp1;
  }
  if (made == NULL || have == length) return head_of(made);
  free(made); /* it is not whole */
  return NULL;
}

static struct ddsi_serdata *from_parts(const struct ddsi_sertype *type, enum ddsi_serdata_kind kind,
                                       ddsrt_msg_iovlen_t count, const ddsrt_iovec_t *parts,
                                       size_t length) {
  struct blob *made = blob_new(type, kind, length);
  size_t have = 0;
  for (size_t part = 0; made != NULL && part < (size_t)count && have < length; part++) {
    size_t some = parts[part].iov_len < length - have ? parts[part].iov_len : length - have;
    memcpy(made->bytes + have, parts[part].iov_base, some);
    have += some;
  }
  return head_of(made);
}

static struct ddsi_serdata *from_key(const struct ddsi_sertype *type,
                                     const struct ddsi_keyhash *hash) {
  (void)hash;
  return head_of(blob_new(type, SDK_KEY, 0));
}

static struct ddsi_serdata *from_sample(const struct ddsi_sertype *type,
                                        enum ddsi_serdata_kind kind, const void *sample) {
  (void)sample;
  return head_of(blob_new(type, kind, 0));
}

static struct ddsi_serdata *without_type(const struct ddsi_serdata *of) {
  struct blob *made = blob_new(of->type, SDK_KEY, 0);
  if (made != NULL) made->head.type = NULL;
  return head_of(made);
}

static bool same_key(const struct ddsi_serdata *one, const struct ddsi_serdata *other) {
  (void)one, (void)other;
  return true; /* no type of ROS has a key */
}

static uint32_t length_of(const struct ddsi_serdata *of) { return blob_of(of)->length; }

static void copy_out(const struct ddsi_serdata *of, size_t from, size_t length, void *into) {
  memcpy(into, blob_of(of)->bytes + from, length);
}

static struct ddsi_serdata *lend(const struct ddsi_serdata *of, size_t from, size_t length,
                                 ddsrt_iovec_t *part) {
  part->iov_base = (void *)(blob_of(of)->bytes + from);
  part->iov_len = (ddsrt_iov_len_t)length;
  return ddsi_serdata_ref(of);
}

static void give_back(struct ddsi_serdata *of, const ddsrt_iovec_t *part) {
  (void)part;
  ddsi_serdata_unref(of);
}

static bool to_sample(const struct ddsi_serdata *of, void *sample, void **room, void *end) {
  (void)of, (void)sample, (void)room, (void)end;
  return false; /* it is not known what is in it */
}

static bool key_to_sample(const struct ddsi_sertype *type, const struct ddsi_serdata *of,
                          void *sample, void **room, void *end) {
  (void)type, (void)of, (void)sample, (void)room, (void)end;
  return true;
}

static void release(struct ddsi_serdata *of) { free(of); }

static size_t print(const struct ddsi_sertype *type, const struct ddsi_serdata *of, char *into,
                    size_t most) {
  (void)type;
  return (size_t)snprintf(into, most, "%u bytes", blob_of(of)->length);
}

static void hash_key(const struct ddsi_serdata *of, struct ddsi_keyhash *into, bool md5) {
  (void)of, (void)md5;
  memset(into, 0, sizeof *into);
}

static const struct ddsi_serdata_ops of_blobs = {
    .eqkey = same_key,
    .get_size = length_of,
    .from_ser = from_fragments,
    .from_ser_iov = from_parts,
    .from_keyhash = from_key,
    .from_sample = from_sample,
    .to_ser = copy_out,
    .to_ser_ref = lend,
    .to_ser_unref = give_back,
    .to_sample = to_sample,
    .to_untyped = without_type,
    .untyped_to_sample = key_to_sample,
    .free = release,
    .print = print,
    .get_keyhash = hash_key,
};

static void release_type(struct ddsi_sertype *type) {
  ddsi_sertype_fini(type);
  free(type);
}

static void zero_samples(const struct ddsi_sertype *type, void *samples, size_t count) {
  (void)type, (void)samples, (void)count;
}

static void more_samples(void **samples, const struct ddsi_sertype *type, void *old,
                         size_t old_count, size_t count) {
  (void)samples, (void)type, (void)old, (void)old_count, (void)count;
}

static void free_samples(const struct ddsi_sertype *type, void **samples, size_t count,
                         dds_free_op_t how) {
  (void)type, (void)samples, (void)count, (void)how;
}

static bool same_type(const struct ddsi_sertype *one, const struct ddsi_sertype *other) {
  (void)one, (void)other;
  return true; /* who asks has compared the names */
}

static uint32_t hash_type(const struct ddsi_sertype *type) {
  (void)type;
  return 0;
}

static const struct ddsi_sertype_ops of_types = {
    .version = ddsi_sertype_v0,
    .free = release_type,
    .zero_samples = zero_samples,
    .realloc_samples = more_samples,
    .free_samples = free_samples,
    .equal = same_type,
    .hash = hash_type,
};

dds_entity_t blob_topic(dds_entity_t participant, const char *name, const char *type_name,
                        const struct ddsi_sertype **type) {
  struct ddsi_sertype *made = calloc(1, sizeof *made);
  if (made == NULL) return DDS_RETCODE_OUT_OF_RESOURCES;
  ddsi_sertype_init(made, type_name, &of_types, &of_blobs, true);
  made->allowed_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1;
  dds_entity_t topic = dds_create_topic_sertype(participant, name, &made, NULL, NULL, NULL);
  if (topic < 0) ddsi_sertype_unref(made);
  *type = made;
  return topic;
}

dds_return_t blob_write(dds_entity_t writer, const struct ddsi_sertype *type, const uint8_t *bytes,
                        size_t length) {
  struct blob *made = blob_new(type, SDK_DATA, length);
  if (made == NULL) return DDS_RETCODE_OUT_OF_RESOURCES;
  memcpy(made->bytes, bytes, length);
  made->head.timestamp.v = dds_time();
  made->head.statusinfo = 0;
  return dds_forwardcdr(writer, &made->head);
}

dds_return_t blob_take(dds_entity_t reader, dds_sample_info_t *info, struct ddsi_serdata **blob) {
  dds_return_t took;
  while ((took = dds_takecdr(reader, blob, 1, info, DDS_ANY_STATE)) == 1 && !info->valid_data)
    ddsi_serdata_unref(*blob); /* a writer that left */
  return took;
}

const uint8_t *blob_bytes(const struct ddsi_serdata *blob, size_t *length) {
  *length = blob_of(blob)->length;
  return blob_of(blob)->bytes;
}

void blob_release(struct ddsi_serdata *blob) { ddsi_serdata_unref(blob); }
