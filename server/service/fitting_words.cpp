// SPDX-License-Identifier: Apache-2.0
#include "server/service/fitting_words.h"

#include <string>
#include <type_traits>
#include <variant>

#include "common/base/utf8.h"
#include "common/wire/limits.h"

namespace cairn {
namespace {

void fit(std::string* words) {
  if (words->size() <= wire::kMaxReasonBytes && !fault_of_text(*words)) return;
  *words = std::string(cut_text(one_line(*words), wire::kMaxReasonBytes));
}

struct Fitting {
  void operator()(wire::SeedVerdict& verdict) const { fit(&verdict.reason); }
  void operator()(wire::OfferVerdict& verdict) const {
    for (wire::OfferOutcome& outcome : verdict.recent) fit(&outcome.reason);
  }
  void operator()(wire::ClientReply& reply) const {
    for (wire::RequestOutcome& outcome : reply.recent) fit(&outcome.reason);
  }
  void operator()(wire::RelocAnswer& answer) const {
    fit(&answer.answer.reason);
    for (PlaceCandidate& candidate : answer.answer.candidates) fit(&candidate.reason);
  }
  template <typename Other>
  void operator()(Other&) const {}
};

}  // namespace

ClientEvent with_fitting_words(ClientEvent event) {
  std::visit(Fitting{}, event);
  return event;
}

}  // namespace cairn
