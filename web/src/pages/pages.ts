// The script of the pages that play cases: the report, and the comparison of two versions of an AV.
import { startComparison } from "./comparison";
import { startReport } from "./report";

if (document.getElementById("figures")) startReport();
else startComparison();
