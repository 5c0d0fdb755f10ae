// SPDX-License-Identifier: Apache-2.0
#include "common/wire/waiter.h"

#include "common/wire/internal/endpoint.h"

namespace cairn::wire {

struct Waiter::State {
  std::shared_ptr<internal::Context> context;
  internal::Entity waitset;
  internal::Entity guard;
};

Result<Waiter> Waiter::create(const Participant& participant) {
  auto state = std::make_unique<State>();
  state->context = participant.context();
  auto waitset = internal::checked(dds_create_waitset(state->context->participant()), "waitset");
  if (!waitset) return tl::unexpected(waitset.error());
  auto guard = internal::checked(dds_create_guardcondition(state->context->participant()), "guard condition");
  if (!guard) return tl::unexpected(guard.error());
  state->waitset = *std::move(waitset);
  state->guard = *std::move(guard);
  if (const dds_return_t code = dds_waitset_attach(state->waitset.handle(), state->guard.handle(), 0);
      code != DDS_RETCODE_OK) {
    return fail(ErrorCode::kInternal, std::string("guard condition: ") + dds_strretcode(-code));
  }
  return Waiter(std::move(state));
}

Waiter::Waiter(std::unique_ptr<State> state) : state_(std::move(state)) {}
Waiter::Waiter(Waiter&&) noexcept = default;
Waiter& Waiter::operator=(Waiter&&) noexcept = default;
Waiter::~Waiter() = default;

Status Waiter::attach(std::initializer_list<std::reference_wrapper<const ReaderBase>> readers) {
  for (const ReaderBase& reader : readers) {
    const dds_return_t code = dds_waitset_attach(state_->waitset.handle(), reader.entity().condition(), 0);
    if (code != DDS_RETCODE_OK)
      return fail(ErrorCode::kInternal, std::string("attaching a reader: ") + dds_strretcode(-code));
  }
  return {};
}

bool Waiter::wait(std::chrono::milliseconds timeout) {
  const dds_return_t triggered =
      dds_waitset_wait(state_->waitset.handle(), nullptr, 0, DDS_MSECS(timeout.count()));
  bool woken = false;
  dds_take_guardcondition(state_->guard.handle(), &woken);
  return triggered > 0 || woken;
}

void Waiter::wake() {
  dds_set_guardcondition(state_->guard.handle(), true);
}

}  // namespace cairn::wire
