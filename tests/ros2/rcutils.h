/* The stand-in's librcutils.so, with the structures that the real one has. */
#pragma once
#include <stddef.h>
#include <stdint.h>

struct allocator {
  void *(*allocate)(size_t size, void *state);
  void (*deallocate)(void *pointer, void *state);
  void *(*reallocate)(void *pointer, size_t size, void *state);
  void *(*zero_allocate)(size_t count, size_t size, void *state);
  void *state;
};
struct strings {
  size_t size;
  char **data;
  struct allocator allocator;
};
struct names_and_types {
  struct strings names;
  struct strings *types; /* for each name */
};
struct error_string {
  char str[1024];
};

struct allocator rcutils_get_default_allocator(void);
struct error_string rcutils_get_error_string(void);
void rcutils_reset_error(void);
int rcutils_string_array_fini(struct strings *of);

/* What only the stand-in has: the thread's error as printf writes it, for what it returns; and a
 * text more in an array. */
int standin_error(int code, const char *format, ...) __attribute__((format(printf, 2, 3)));
void standin_add(struct strings *to, const char *text);
