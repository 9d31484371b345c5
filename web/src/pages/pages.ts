// The script of the pages that play cases: the report, one case alone, and the comparison of two versions of an AV.
import { startComparison } from "./comparison";
import { startReport } from "./report";
import { showFirst } from "./look";
import { pageData } from "./player";

if (document.getElementById("figures")) startReport();
else if (document.getElementById("look")) showFirst(pageData("cases"));
else startComparison();
