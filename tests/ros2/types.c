/* lib<package>__rosidl_typesupport_c.so of the package that -DPACKAGE names, with the messages of
 * -DMESSAGES='MESSAGE(Name) ...'. What they consist of nobody needs: they are passed on as bytes. */
#include "rmw.h"

#define TEXT_OF(name) #name
#define TEXT(name) TEXT_OF(name)
#define HANDLE_OF(package, name) \
  rosidl_typesupport_c__get_message_type_support_handle__##package##__msg__##name
#define HANDLE(package, name) HANDLE_OF(package, name)

#define MESSAGE(name)                                                                       \
  static const struct type_name name_of_##name = {TEXT(PACKAGE), "msg", TEXT(name)};        \
  const void *HANDLE(PACKAGE, name)(void);                                                  \
  const void *HANDLE(PACKAGE, name)(void) {                                                 \
    static const struct type_support support = {"rosidl_typesupport_c", &name_of_##name, NULL}; \
    return &support;                                                                        \
  }

MESSAGES
