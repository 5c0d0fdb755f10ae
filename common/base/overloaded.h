// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cairn {

/// A visitor for std::visit, made of several lambdas, one for each alternative.
template <typename... Cases>
struct Overloaded : Cases... {
  using Cases::operator()...;
};
template <typename... Cases>
Overloaded(Cases...) -> Overloaded<Cases...>;  // Clang 14 does not deduce the arguments of an aggregate

}  // namespace cairn
