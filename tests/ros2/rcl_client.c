/* Clients of services. */
#include "rcl.h"

struct rcl_client_options rcl_client_get_default_options(void) {
  struct rcl_client_options options = {
      .qos = rcl_publisher_get_default_options().qos,
      .allocator = rcutils_get_default_allocator(),
  };
  return options;
}

int rcl_client_init(struct rcl_client *client, const struct rcl_node *node,
                    const struct type_support *type, const char *service,
                    const struct rcl_client_options *options) {
  if (type == NULL || client->impl != NULL || options->allocator.allocate == NULL)
    return standin_error(RCL_INVALID_ARGUMENT, "%s: no type, or it is initialized", service);
  if (service[0] != '/' || !rcl_is_name(service + 1, '/'))
    return standin_error(RCL_SERVICE_NAME_INVALID, "%s is no name of a service", service);
  client->impl = rmw_create_client(node->impl, type, service, &options->qos);
  return client->impl == NULL ? RCL_ERROR : RCL_OK;
}

int rcl_client_fini(struct rcl_client *client, struct rcl_node *node) {
  return rmw_destroy_client(node->impl, client->impl);
}

int rcl_service_server_is_available(const struct rcl_node *node, const struct rcl_client *client,
                                    bool *available) {
  return rmw_service_server_is_available(node->impl, client->impl, available);
}

int rcl_send_request(const struct rcl_client *client, const void *request, int64_t *sequence) {
  return rmw_send_request(client->impl, request, sequence);
}

int rcl_take_response(const struct rcl_client *client, struct rmw_request_id *id, void *response) {
  struct rmw_service_info info;
  bool taken = false;
  int failed = rmw_take_response(client->impl, &info, response, &taken);
  if (taken) *id = info.id;
  return failed || taken ? failed : RCL_CLIENT_TAKE_FAILED;
}
