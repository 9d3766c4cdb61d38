#define _GNU_SOURCE
#include "rcl.h"

#include <dlfcn.h>
#include <stdio.h>
#include <string.h>

struct rcl rcl;

static const char *loader_says(void) {
  const char *text = dlerror();
  return text == NULL ? "the loader does not say why" : text;
}

const char *rcl_load(bool *symbol) {
  *symbol = false;
  void *library = dlopen("librcl.so", RTLD_NOW | RTLD_GLOBAL);
  if (library == NULL) return loader_says();
  *symbol = true;
#define RCL_LOOK_UP(result, name, arguments)                 \
  rcl.name = (__typeof__(rcl.name))dlsym(library, #name);    \
  if (rcl.name == NULL) return #name;
  RCL_FUNCTIONS(RCL_LOOK_UP)
  return NULL;
}

void *rcl_rmw_function(const char *symbol) {
  /* librcl is linked to what has it: librmw_implementation.so, or the one middleware that it was built for. */
  void *library = dlopen("librcl.so", RTLD_NOW | RTLD_NOLOAD);
  void *found = library == NULL ? NULL : dlsym(library, symbol);
  if (library != NULL) dlclose(library);
  return found;
}

void *rcl_function(const char *library, const char *symbol, struct answer *into) {
  void *loaded = dlopen(library, RTLD_NOW);
  void *found = loaded == NULL ? NULL : dlsym(loaded, symbol);
  if (found != NULL) return found;
  const char *missing = loader_says();
  answer_failed(into, loaded == NULL ? STATUS_PACKAGE : STATUS_TYPE, library);
  if (loaded == NULL) answer_text(into, missing);
  return NULL;
}

const void *rcl_type(const char *package, const char *folder, const char *name,
                     struct answer *into) {
  char library[512], symbol[1024];
  snprintf(library, sizeof library, "lib%s__rosidl_typesupport_c.so", package);
  snprintf(symbol, sizeof symbol,
           "rosidl_typesupport_c__get_message_type_support_handle__%s__%s__%s", package, folder,
           name);
  const void *(*get)(void) = (const void *(*)(void))rcl_function(library, symbol, into);
  return get == NULL ? NULL : get();
}

void rcl_reason(char *into, size_t most) {
  struct blob text;
  memset(&text, 0, sizeof text);
  text = rcl.rcutils_get_error_string();
  snprintf(into, most, "%.1023s", text.bytes);
  rcl.rcutils_reset_error();
}

void answer_rcl(struct answer *into, const char *function, int returned) {
  char reason[1024];
  rcl_reason(reason, sizeof reason);
  answer_call(into, function, returned, reason);
}
