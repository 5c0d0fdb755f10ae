// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>

#include <memory>
#include <string>
#include <utility>

#include "common/base/result.h"

namespace cairn::wire::internal {

/// Owns a DDS entity and, with it, its children.
class Entity {
 public:
  Entity() = default;
  explicit Entity(dds_entity_t handle) : handle_(handle) {}
  Entity(Entity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Entity& operator=(Entity&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Entity() {
    if (handle_ > 0) dds_delete(handle_);
  }
  [[nodiscard]] dds_entity_t handle() const { return handle_; }

 private:
  dds_entity_t handle_ = 0;
};

/// The entity that a dds_create_* function returned, or an error "<what>: <the middleware's reason>":
/// kRefused where our own keys do not permit it.
[[nodiscard]] inline Result<Entity> checked(dds_entity_t created, const std::string& what) {
  if (created == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY)
    return fail(ErrorCode::kRefused, what + ": the permissions of our keys (--security) do not allow it");
  if (created < 0) return fail(ErrorCode::kInternal, what + ": " + dds_strretcode(-created));
  return Entity(created);
}

struct QosDelete {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
using QosPtr = std::unique_ptr<dds_qos_t, QosDelete>;

struct DdsFree {
  void operator()(void* memory) const { dds_free(memory); }
};
/// Owns what the middleware has allocated for its caller.
template <typename T>
using DdsPtr = std::unique_ptr<T, DdsFree>;

}  // namespace cairn::wire::internal
