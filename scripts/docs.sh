#!/bin/bash
# The documentation as a site that works without a network: results/docs/html/index.html. Needs the built workspace
# sourced (make docs does both). Warnings are errors; public members without a comment are only listed.
# docs.sh --quick leaves out the pages of the C++ and Python interfaces. PHRI_DOCS=folder writes elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH=/usr/bin:/bin:$PATH PHRI_DOCS=${PHRI_DOCS:-$PWD/results/docs} PYTHONDONTWRITEBYTECODE=1
quick=0
case ${1:-} in
  '') ;;
  --quick) quick=1 ;;
  *)
    echo "usage: docs.sh [--quick]" >&2
    exit 64
    ;;
esac

needs()
{
  echo "docs: $1" >&2
  exit 66
}
for module in sphinx myst_parser sphinx_rtd_theme breathe matplotlib; do
  /usr/bin/python3 -c "import $module" 2>/dev/null || needs "the Python module $module is missing: make setup"
done
if [ $quick = 0 ]; then
  command -v doxygen >/dev/null || needs "doxygen is missing: make setup"
  /usr/bin/python3 -c 'import phri_sim' 2>/dev/null || needs "the workspace is not built or not sourced: make build"
fi

mkdir -p "$PHRI_DOCS"
rm -rf "${PHRI_DOCS:?}/html" "$PHRI_DOCS/xml"
if [ $quick = 1 ]; then
  /usr/bin/python3 docs/site_pages.py stage "$PHRI_DOCS/source"
else
  doxygen docs/Doxyfile
  /usr/bin/python3 docs/site_pages.py stage "$PHRI_DOCS/source" "$PHRI_DOCS/xml"
  /usr/bin/python3 docs/site_pages.py undocumented "$PHRI_DOCS/xml" >"$PHRI_DOCS/undocumented.txt"
  echo "docs: $(wc -l <"$PHRI_DOCS/undocumented.txt") public members have no comment: $PHRI_DOCS/undocumented.txt"
fi
PHRI_DOCS_QUICK=$quick sphinx-build -q -W --keep-going -b html -c docs -d "$PHRI_DOCS/doctrees" "$PHRI_DOCS/source" "$PHRI_DOCS/html"
echo "docs: $PHRI_DOCS/html/index.html"
