#pragma once
// Arrays of the module: stacks of matrices over the stages, in and out.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <optional>
#include <string>
#include <vector>

namespace phri_control::python
{
namespace py = pybind11;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

inline std::string shapeOf(const Array& array)
{
  std::string text = "(";
  for (py::ssize_t i = 0; i < array.ndim(); ++i)
    text += (i ? ", " : "") + std::to_string(array.shape(i));
  return text + ")";
}

/// One matrix per leading index of `array`, or a single one if `array` has no leading index. A vector counts as a
/// column.
class Stack
{
public:
  Stack(const std::string& name, const Array& array, bool vectors) : name_(name), array_(array), vectors_(vectors)
  {
    const py::ssize_t single = vectors ? 1 : 2;
    if (array.ndim() != single && array.ndim() != single + 1)
      throw py::value_error(name + " has shape " + shapeOf(array) + ", expected " +
                            (vectors ? "(n,) or (T, n)" : "(n, m) or (T, n, m)"));
    stacked_ = array.ndim() == single + 1;
    count_ = stacked_ ? array.shape(0) : 1;
    rows_ = array.shape(stacked_ ? 1 : 0);
    cols_ = vectors ? 1 : array.shape(stacked_ ? 2 : 1);
  }

  Eigen::MatrixXd at(py::ssize_t k) const
  {
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    return Eigen::Map<const RowMajor>(array_.data() + (stacked_ ? k : 0) * rows_ * cols_, rows_, cols_);
  }
  std::vector<Eigen::MatrixXd> all() const
  {
    std::vector<Eigen::MatrixXd> matrices;
    for (py::ssize_t k = 0; k < count_; ++k)
      matrices.push_back(at(k));
    return matrices;
  }
  /// Settles the horizon: all stacks must agree with each other and with the number given.
  void agree(std::optional<py::ssize_t>& horizon) const
  {
    if (stacked_ && horizon && *horizon != count_)
      throw py::value_error(name_ + " has " + std::to_string(count_) + " stages, expected " + std::to_string(*horizon) +
                            " as in the horizon or the other arrays");
    if (stacked_)
      horizon = count_;
  }
  py::ssize_t rows() const { return rows_; }
  py::ssize_t cols() const { return cols_; }

private:
  std::string name_;
  Array array_;
  bool vectors_, stacked_ = false;
  py::ssize_t count_ = 0, rows_ = 0, cols_ = 0;
};

/// The same member of every element, stacked along a new first axis: (T, rows, cols), or (T, rows) for vectors.
template <typename Items, typename Member>
Array stacked(const Items& items, const Member& member, bool vectors)
{
  const py::ssize_t count = items.size(), rows = count ? member(items[0]).rows() : 0,
                    cols = count ? member(items[0]).cols() : 0;
  Array array(vectors ? std::vector<py::ssize_t>{ count, rows } : std::vector<py::ssize_t>{ count, rows, cols });
  double* out = array.mutable_data();
  for (const auto& item : items)
    for (py::ssize_t i = 0; i < rows; ++i)
      for (py::ssize_t j = 0; j < cols; ++j)
        *out++ = member(item)(i, j);
  return array;
}

/// Policy of a solution as arrays: gains (T, m, n), feedforward (T, m).
template <typename Solution>
Array gainsOf(const Solution& solution)
{
  return stacked(
      solution.gains, [](const auto& item) -> const auto& { return item; }, false);
}
template <typename Solution>
Array feedforwardOf(const Solution& solution)
{
  return stacked(
      solution.feedforward, [](const auto& item) -> const auto& { return item; }, true);
}

/// Gains and feedforward of a policy as `evaluate` and its like take them.
struct PolicyStages
{
  std::vector<Eigen::MatrixXd> gains;
  std::vector<Eigen::VectorXd> feedforward;
};

/// From gains (T, m, n) or (m, n), feedforward (T, m) or (m). Throws std::invalid_argument naming what does not fit.
inline PolicyStages policyStages(std::size_t horizon, const Array& gains, const Array& feedforward)
{
  const Stack gain("gains", gains, false), force("feedforward", feedforward, true);
  std::optional<py::ssize_t> count = horizon;
  gain.agree(count);
  force.agree(count);
  PolicyStages stages;
  for (std::size_t k = 0; k < horizon; ++k)
  {
    stages.gains.push_back(gain.at(k));
    stages.feedforward.push_back(force.at(k));
  }
  return stages;
}

// what the other files of this folder add to the module
void bindContact(py::module_& m);
void bindCumulants(py::module_& m);
void bindIterative(py::module_& m);
void bindMultiplicative(py::module_& m);
void bindPlants(py::module_& m);
void bindRisk(py::module_& m);
void bindRollOuts(py::module_& m);
void bindSensor(py::module_& m);
}  // namespace phri_control::python
