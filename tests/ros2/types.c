/* lib<package>__rosidl_typesupport_c.so of the package that -DPACKAGE names, with the messages of
 * -DMESSAGES='MESSAGE(Name) EVENT(Name) SERVICE(Name) ...', of which services and their events are in
 * the folder srv. They are passed on as bytes. */
#include "rmw.h"

#define TEXT_OF(name) #name
#define TEXT(name) TEXT_OF(name)
#define HANDLE_OF(package, folder, name) \
  rosidl_typesupport_c__get_message_type_support_handle__##package##__##folder##__##name
#define HANDLE(package, folder, name) HANDLE_OF(package, folder, name)

#define MESSAGE(name) TYPE(msg, name)
#define EVENT(name) TYPE(srv, name)
#define SERVICE(name)                                                                         \
  static const struct type_name name_of_##name = {TEXT(PACKAGE), "srv", TEXT(name)};          \
  const void *SERVICE_HANDLE(PACKAGE, name)(void);                                            \
  const void *SERVICE_HANDLE(PACKAGE, name)(void) {                                           \
    static const struct type_support support = {"rosidl_typesupport_c", &name_of_##name, NULL}; \
    return &support;                                                                          \
  }
#define SERVICE_HANDLE_OF(package, name) \
  rosidl_typesupport_c__get_service_type_support_handle__##package##__srv__##name
#define SERVICE_HANDLE(package, name) SERVICE_HANDLE_OF(package, name)
#define TYPE(folder, name)                                                                  \
  static const struct type_name name_of_##name = {TEXT(PACKAGE), TEXT(folder), TEXT(name)}; \
  const void *HANDLE(PACKAGE, folder, name)(void);                                          \
  const void *HANDLE(PACKAGE, folder, name)(void) {                                         \
    static const struct type_support support = {"rosidl_typesupport_c", &name_of_##name, NULL}; \
    return &support;                                                                        \
  }

MESSAGES
