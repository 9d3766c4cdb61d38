#include "rcutils.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static _Thread_local struct error_string error;

static void *allocate(size_t size, void *state) {
  (void)state;
  return malloc(size);
}

static void deallocate(void *pointer, void *state) {
  (void)state;
  free(pointer);
}

static void *reallocate(void *pointer, size_t size, void *state) {
  (void)state;
  return realloc(pointer, size);
}

static void *zero_allocate(size_t count, size_t size, void *state) {
  (void)state;
  return calloc(count, size);
}

struct allocator rcutils_get_default_allocator(void) {
  return (struct allocator){allocate, deallocate, reallocate, zero_allocate, NULL};
}

struct error_string rcutils_get_error_string(void) {
  static const struct error_string none = {"error not set"};
  return error.str[0] == 0 ? none : error;
}

void rcutils_reset_error(void) { error.str[0] = 0; }

int standin_error(int code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(error.str, sizeof error.str, format, arguments);
  va_end(arguments);
  return code;
}

void standin_add(struct strings *to, const char *text) {
  to->data = realloc(to->data, (to->size + 1) * sizeof *to->data);
  if (to->data == NULL || (to->data[to->size++] = strdup(text)) == NULL) abort();
}

int rcutils_string_array_fini(struct strings *of) {
  for (size_t one = 0; one < of->size; one++) free(of->data[one]);
  free(of->data);
  memset(of, 0, sizeof *of);
  return 0;
}
