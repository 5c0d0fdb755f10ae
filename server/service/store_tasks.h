// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "server/service/map_runner.h"
#include "server/service/operator_answer.h"
#include "server/service/service_context.h"

namespace cairn {

/// `work` is run on the store's strand, beside its writer, so that no verdict waits for it, and gives what is
/// then to be done on the service's thread. If it throws, that is the answer; without a store as well.
void on_store_strand(const ServiceContext& context, const AdminAnswer& answer,
                     std::function<Task(Store& store)> work);

/// on_store_strand(), once all that was handed in of the map before is in its file; if it does not get there,
/// the answer says so.
void on_store_strand_when_kept(const ServiceContext& context, MapRunner& runner, const AdminAnswer& answer,
                               std::function<Task(Store& store)> work);

/// An answer, as what is to be done on the service's thread.
[[nodiscard]] Task telling(const AdminAnswer& answer, OperatorAnswer told);

}  // namespace cairn
