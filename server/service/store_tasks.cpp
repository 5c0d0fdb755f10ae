// SPDX-License-Identifier: Apache-2.0
#include "server/service/store_tasks.h"

#include <exception>
#include <utility>

namespace cairn {

void on_store_strand(const ServiceContext& context, const AdminAnswer& answer,
                     std::function<Task(Store& store)> work) {
  if (context.store == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  context.store->run_on_strand([&context, answer, work = std::move(work)](Store& store) {
    Task next;
    try {
      next = work(store);
    } catch (const std::exception& problem) {
      context.log->error("internal error in an operator's request: {}", problem.what());
      next = telling(answer, refusal(ErrorCode::kInternal, "internal error; the server's log says more"));
    }
    if (next) context.post(std::move(next));
  });
}

void on_store_strand_when_kept(const ServiceContext& context, MapRunner& runner, const AdminAnswer& answer,
                               std::function<Task(Store& store)> work) {
  // What was handed to the writer is in the file once a task of its own has come to its turn.
  runner.flush([&context, answer, work = std::move(work)](const Status& kept) {
    if (!kept) return context.post(telling(answer, refusal(kept.error())));
    context.store->run([&context, answer, work](const Store&) { on_store_strand(context, answer, work); });
  });
}

Task telling(const AdminAnswer& answer, OperatorAnswer told) {
  return [answer, told = std::move(told)] { answer(told); };
}

}  // namespace cairn
