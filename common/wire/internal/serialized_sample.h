// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>

#include <memory>
#include <utility>

#include "common/wire/internal/context.h"

namespace cairn::wire::internal {

/// A sample in the form in which the middleware sends and keeps it: writers that are given it refer to it.
class SerializedSample {
 public:
  /// Takes `data` over.
  SerializedSample(std::shared_ptr<Context> context, ddsi_serdata* data, size_t payload_bytes)
      : context_(std::move(context)), data_(data), payload_bytes_(payload_bytes) {}
  ~SerializedSample() { ddsi_serdata_unref(data_); }
  SerializedSample(const SerializedSample&) = delete;
  SerializedSample& operator=(const SerializedSample&) = delete;

  [[nodiscard]] ddsi_serdata* data() const { return data_; }
  [[nodiscard]] const Context& context() const { return *context_; }
  [[nodiscard]] size_t payload_bytes() const { return payload_bytes_; }

 private:
  std::shared_ptr<Context> context_;  ///< the memory goes back to a pool of its domain
  ddsi_serdata* data_;
  size_t payload_bytes_;
};

}  // namespace cairn::wire::internal
